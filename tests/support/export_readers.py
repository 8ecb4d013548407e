"""Exported files, read by independent readers."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any, NamedTuple

import c3d
import numpy as np
from numpy.typing import NDArray
from pygltflib import GLTF2
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # it imports a package by its old name
    import bvhio as bvhio  # noqa: PLC0414 for tests, too


def read_gltf(path: Path) -> Any:
    """A glTF file."""
    return GLTF2().load(str(path))


def array_of(gltf: Any, number: int) -> NDArray[Any]:
    """An accessor's values (N, ...)."""
    accessor = gltf.accessors[number]
    view = gltf.bufferViews[accessor.bufferView]
    kind = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[accessor.componentType]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
    data = np.frombuffer(gltf.binary_blob(), kind, accessor.count * width, view.byteOffset)
    return data.reshape(accessor.count, width)


def world_matrices(gltf: Any, f: int) -> dict[str, Array]:
    """Node name -> its 4x4 place in the world at keyframe f."""
    turns: dict[int, NDArray[Any]] = {}
    places = {n: np.array(node.translation or (0, 0, 0)) for n, node in enumerate(gltf.nodes)}
    turns |= {n: np.array(node.rotation) for n, node in enumerate(gltf.nodes) if node.rotation}
    animation = gltf.animations[0]
    for channel in animation.channels:
        values = array_of(gltf, animation.samplers[channel.sampler].output)[f]
        (turns if channel.target.path == "rotation" else places)[channel.target.node] = values
    world: dict[str, Array] = {}

    def descend(n: int, above: Array) -> None:
        here = np.eye(4)
        here[:3, :3] = Rotation.from_quat(turns.get(n, (0, 0, 0, 1))).as_matrix()
        here[:3, 3] = places[n]
        world[gltf.nodes[n].name] = above @ here
        for child in gltf.nodes[n].children or []:
            descend(child, above @ here)

    for n in gltf.scenes[0].nodes:
        descend(n, np.eye(4))
    return world


def c3d_points(path: Path) -> tuple[list[str], Array, float]:
    """Labels, points with residuals (F, N, 4) and the rate of a C3D file, by the package `c3d`."""
    with path.open("rb") as file, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="No analog data")
        reader = c3d.Reader(file)
        points = np.stack([points for _, points, _ in reader.read_frames()])
        return [label.strip() for label in reader.point_labels], points[..., :4], reader.point_rate


def bvh_joints(path: Path, names: tuple[str, ...], frames: int) -> Array:
    """Places (F, J, 3) of named joints in centimetres, as bvhio works them out of the file's angles."""
    root = bvhio.readAsHierarchy(str(path))
    places = np.empty((frames, len(names), 3))
    for f in range(frames):
        root.loadPose(f)
        by_name = {joint.Name: joint for joint, _, _ in root.layout()}
        places[f] = [tuple(by_name[name].PositionWorld) for name in names]
    return places


class PlainJoint(NamedTuple):
    """A joint in a BVH file: the index of its parent, -1 for the root, and its offset (3,), centimetres."""

    name: str
    parent: int
    offset: Array
    channels: list[str]


def plain_bvh(path: Path) -> tuple[list[PlainJoint], Array]:
    """The joints of a BVH file, and the values (F, C) of all channels."""
    head, _, motion = path.read_text().partition("MOTION")
    joints, open_joints = list[PlainJoint](), list[int]()
    for words in (line.split() for line in head.splitlines()):
        match words:
            case ["ROOT" | "JOINT" | "End", name]:
                joints.append(PlainJoint(name, open_joints[-1] if open_joints else -1, np.zeros(3), []))
            case ["{"]:
                open_joints.append(len(joints) - 1)
            case ["}"]:
                open_joints.pop()
            case ["OFFSET", *values]:
                joints[-1].offset[:] = [float(value) for value in values]
            case ["CHANNELS", _, *channels]:
                joints[-1].channels.extend(channels)
    rows = [[float(cell) for cell in row.split()] for row in motion.strip().splitlines()[2:]]
    return joints, np.array(rows)


def plain_bvh_joints(path: Path, names: tuple[str, ...], *, translates: bool) -> Array:
    """Places (F, J, 3) of named joints in centimetres, as simple importers work them out.

    They move the root; other joints only if they honour translations (`translates`), added to the offset.
    """
    joints, rows = plain_bvh(path)
    columns, places, turns = iter(rows.T), list[Array](), list[Rotation]()
    for n, joint in enumerate(joints):
        place, turn = np.tile(joint.offset, (len(rows), 1)), Rotation.identity(len(rows))
        for channel in joint.channels:
            values = next(columns)
            if channel.endswith("rotation"):
                turn = turn * Rotation.from_euler(channel[0], values[:, None], degrees=True)
            elif translates or n == 0:
                place[:, "XYZ".index(channel[0])] += values
        if joint.parent >= 0:
            above = turns[joint.parent]
            place, turn = places[joint.parent] + above.apply(place), above * turn
        places.append(place)
        turns.append(turn)
    found = [joint.name for joint in joints]
    return np.stack([places[found.index(name)] for name in names], axis=1)
