"""Proposals for single limbs of a body (preset `default`).

Twenty particles cannot cover 24 dimensions, but limbs move and are lost one by one. So a share of the
particles is data-driven: one limb is moved to unexplained observed points. One particle follows the motion
model exactly. The others get noise with the covariance of their hypothesis. If the prediction explains the
points, few particles are enough.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import ROTATION, BodyModel
from gepf.common.compiling import numba
from gepf.common.kinematics import link_transforms, shaped
from gepf.common.kinematics.chain import blend_each, contiguous
from gepf.coordinator.settings import ExplorationSettings


class Limb(NamedTuple):
    """A branch of the kinematic tree up to its last links."""

    group: int  # index of the group of degrees of freedom
    dofs: Indices  # (d,)
    low: Array  # (d,) lower limit of the drawn values
    high: Array


class Part(NamedTuple):
    """Some vertices (V, 3) of a body at rest that one group moves, their change by shape, their skinning."""

    vertices: Array
    shape_vertices: Array  # (S, V, 3)
    links: Indices  # (V, K)
    weights: Array


class Layout(NamedTuple):
    """The parts of a body that are compared with the observed points, one per group, and the limbs."""

    parts: tuple[Part, ...]
    limbs: tuple[Limb, ...]


def explain(model: BodyModel, pose: Array, points: Array, settings: ExplorationSettings) -> Mask:
    """Which points (P, 3) are near each part of a body in pose (D,): (G, P)."""
    parts, transforms = layout_of(model, settings.vertices).parts, link_transforms(model, pose[None])
    posed = [pose_part(part, pose[None], transforms) for part in parts]
    return np.array([mark_near(points, vertices, settings.near_m)[0] for vertices in posed])


def pose_part(part: Part, poses: Array, transforms: Array) -> Array:
    """The vertices (N, V, 3) of a part in poses (N, D), given the transforms of all links (N, L, 3, 4)."""
    vertices = shaped(part.vertices, part.shape_vertices, poses)
    return blend_each(vertices, part.links, part.weights, transforms)


def choose_count(most: int, near: Mask, settings: ExplorationSettings, cameras: int = 1) -> int:
    """How many particles a frame needs, by the share of the points that the prediction leaves unexplained.

    `near` (G, P) is from `explain`. The number of images to draw, particles times cameras, is the same for
    any number of cameras, because less is hidden from several cameras.
    """
    unexplained = 1.0 - near.any(axis=0).mean() if near.size else 1.0
    needed = math.ceil(most * unexplained / settings.max_unexplained_share)
    images = min(most, max(settings.min_particles, needed))
    return math.ceil(images / cameras)


def choose_kinds(
    count: int, rng: np.random.Generator, settings: ExplorationSettings, cameras: int = 1
) -> tuple[Mask, Mask]:
    """Which particles (N,) get noise, and which are data-driven; the first is the prediction.

    If a frame has only the least number of particles, none of them is data-driven.
    """
    more = count > math.ceil(settings.min_particles / cameras)
    data_driven = rng.permutation(count) < (settings.data_driven_share * count if more else 0)
    spread = ~data_driven
    spread[0] = data_driven[0] = False
    return spread, data_driven


def propose_limbs(
    model: BodyModel,
    pose: Array,
    points: Array,
    near: Mask,
    count: int,
    rng: np.random.Generator,
    settings: ExplorationSettings,
) -> list[tuple[Indices, Array]]:
    """`count` proposals: degrees of freedom (d,) of a limb, and values (d,) that explain more points.

    For each limb of pose (D,) joint values are drawn uniformly within the limits. The gain of a draw is the
    number of points (P, 3) that become explained minus the number that become unexplained; `near` (G, P) is
    from `explain`. A draw is chosen with probability proportional to its squared gain. Empty if no draw has
    a gain.
    """
    layout, explained = layout_of(model, settings.vertices), near.sum(axis=0)
    per_limb, draws, gains = settings.draws, [], []
    for limb in layout.limbs if count else ():
        mine = near[limb.group]
        held = np.repeat(pose[None], per_limb, axis=0)
        held[:, limb.dofs] = rng.uniform(limb.low, limb.high, size=(per_limb, len(limb.dofs)))
        posed = pose_part(layout.parts[limb.group], held, link_transforms(model, held))
        reached = mark_near(points[explained == mine], posed, settings.near_m).sum(axis=1)
        draws.append(held[:, limb.dofs])
        gains.append(np.maximum(0, reached - np.count_nonzero(mine & (explained == 1))))
    weights = np.concatenate(gains) ** 2 if gains else np.zeros(0)
    if not weights.any():
        return []
    drawn = rng.choice(len(weights), size=count, p=weights / weights.sum())
    return [(layout.limbs[k // per_limb].dofs, draws[k // per_limb][k % per_limb]) for k in drawn]


def mark_near(points: Array, vertices: Array, near_m: float) -> Mask:
    """Which points (P, 3) are near a vertex of each of several surfaces (K, V, 3), (K, P)."""
    near = np.empty((len(vertices), len(points)), dtype=np.bool_)
    fill_near(np.ascontiguousarray(points.T), vertices, near_m, near)
    return near


@numba.njit(cache=True, nogil=True)
def fill_near(points: Array, vertices: Array, near_m: float, near: Mask) -> None:
    """`mark_near` of points (3, P), in this layout for vectorised code."""
    near[:] = False
    for k in range(len(vertices)):
        for v in range(vertices.shape[1]):
            x, y, z = vertices[k, v]
            for p in range(points.shape[1]):
                dx, dy, dz = points[0, p] - x, points[1, p] - y, points[2, p] - z
                near[k, p] |= dx * dx + dy * dy + dz * dz <= near_m * near_m


@lru_cache(maxsize=16)
def layout_of(model: BodyModel, vertices: int) -> Layout:
    """The limbs of a body, and about `vertices` of its vertices, to be compared with observed points.

    A group is a set of degrees of freedom that move independently of others: a branch of the tree, or the
    trunk. A limb is a rotating group below another group.
    """
    children = np.bincount(model.parents[model.parents >= 0], minlength=len(model.parents))
    start_of = np.arange(len(model.parents))
    for j, parent in enumerate(model.parents):
        if parent >= 0 and children[parent] == 1:
            start_of[j] = start_of[parent]
    starts, group_of_dof = np.unique(start_of, return_inverse=True)
    groups = [np.flatnonzero(start_of == start) for start in starts]
    group_of_dof = np.append(group_of_dof, 0)  # for fixed vertices
    some = np.arange(0, len(model.vertices), max(1, len(model.vertices) // vertices))
    group_of = group_of_dof[model.link_dofs[model.skin_links[some, 0]]]
    limbs = []
    for number, dofs in enumerate(groups):
        carries = np.any(np.isin(model.parents, dofs) & (group_of_dof[:-1] != number))
        turns = np.all(model.kinds[dofs] == ROTATION)
        if model.parents[dofs[0]] >= 0 and turns and not carries and np.any(group_of == number):
            limbs.append(Limb(number, dofs, *np.clip(model.limits[dofs], -np.pi, np.pi).T))
    mine = [some[group_of == number] for number in range(len(groups))]
    directions = model.shape_vertices
    parts = (
        Part(model.vertices[v], contiguous(directions[:, v]), model.skin_links[v], model.skin_weights[v])
        for v in mine
    )
    return Layout(tuple(parts), tuple(limbs))
