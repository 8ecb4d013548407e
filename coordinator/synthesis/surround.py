"""Cameras around a scene: the same motion in each camera's frame and at its times, and a room."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from scipy.interpolate import CubicSpline

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS
from gepf.common.camera import inverse, moved
from gepf.common.errors import InputError
from gepf.common.kinematics import pose_vertices
from gepf.common.kinematics.rotations import euler_angles, euler_matrix
from gepf.coordinator.synthesis.scenes import Scene


class Room(msgspec.Struct, frozen=True):
    """A room around a person; a wall is not drawn for a camera outside it."""

    wall_m: float = 2.2  #: from the person to each wall
    height_m: float = 2.7


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A scene as one camera of a rig sees it. T_rig_camera (4, 4), metres; its clock is late by offset_s."""

    name: str
    scene: Scene
    T_rig_camera: Array
    offset_s: float


def surround(scene: Scene, cameras: int, apart_deg: float, late_s: float) -> Iterator[Seen]:
    """The scene from cameras around the person; the first one is the scene's own.

    Each further one is turned by `apart_deg` about the person's place, and takes its images `late_s` later
    than the one before it.
    """
    if not set(ROOT_DOFS) <= set(scene.model.dof_names):
        raise InputError("the base of this body is fixed, so only one camera can see it; give another scene")
    middle = root_places(scene).mean(axis=0)
    for n in range(cameras):
        placed = np.eye(4)
        placed[:3, :3] = euler_matrix(np.array([0.0, -n * np.radians(apart_deg), 0.0]))
        placed[:3, 3] = middle - placed[:3, :3] @ middle
        yield Seen(f"cam{n}", seen_from(later(scene, n * late_s), placed), placed, n * late_s)


def furnished(scene: Scene, room: Room = Room()) -> Scene:  # noqa: B008 it is frozen
    """The scene in a room: floor, ceiling and four walls."""
    x, _, z = root_places(scene).mean(axis=0)
    floor = max(float(pose_vertices(each.model, each.poses)[..., 1].max()) for each in (scene, *scene.others))
    low = np.array([x - room.wall_m, floor - room.height_m, z - room.wall_m])
    high = np.array([x + room.wall_m, floor, z + room.wall_m])
    corners = np.array([[(low, high)[k >> a & 1][a] for a in range(3)] for k in range(8)])
    quads = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    return replace(scene, room=(corners, np.concatenate([quads[:, [0, 2, 1]], quads[:, [0, 3, 2]]])))


def root_places(scene: Scene) -> Array:
    """Places (F, 3) of the root."""
    return np.asarray(scene.poses[:, [scene.model.dof_names.index(name) for name in ROOT_DOFS[:3]]])


def later(scene: Scene, late_s: float) -> Scene:
    """The scene at later times; after its last frame the motion goes on for a moment."""
    if late_s == 0.0:
        return scene
    frames = np.arange(len(scene.poses))
    poses = CubicSpline(frames, scene.poses)(frames + late_s * scene.fps)
    others = tuple(later(each, late_s) for each in scene.others)
    start = None if scene.start is None else poses[0].copy()
    return replace(scene, poses=poses, start=start, others=others)


def seen_from(scene: Scene, placed: Array) -> Scene:
    """The scene in the frame of a camera at T_rig_camera (4, 4)."""
    back = inverse(placed)
    poses = np.array([moved_root(scene, pose, back) for pose in scene.poses])
    start = None if scene.start is None else moved_root(scene, scene.start, back)
    room = None if scene.room is None else (moved(scene.room[0], back), scene.room[1])
    others = tuple(seen_from(each, placed) for each in scene.others)
    return replace(scene, poses=poses, start=start, others=others, room=room)


def moved_root(scene: Scene, pose: Array, transform: Array) -> Array:
    """A pose (D,) after a rigid transform (4, 4)."""
    places = [scene.model.dof_names.index(name) for name in ROOT_DOFS]
    after = pose.copy()
    after[places[:3]] = moved(pose[places[:3]], transform)
    turned = transform[:3, :3] @ euler_matrix(pose[places[3:]])
    after[places[3:]] = euler_angles(turned, pose[places[3:]])
    return after
