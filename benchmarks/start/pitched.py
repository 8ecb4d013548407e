"""A person as a raised camera sees it that looks down: a performance that three cameras saw, drawn anew.

The surfaces in the three depth images of each moment are put together; a camera that no recording was made
with sees them, in a room with a floor and a wall, with a time-of-flight camera's noise. The
crown of the head, which none of the three saw, is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, median_filter

from benchmarks.start.cases import Case, Footage, measured, read_skinned
from common.camera import Intrinsics, back_project
from common.frame import DepthFrame
from coordinator.scene.ransac import load_open3d

Array = NDArray[np.float64]

JUMP = 0.06  # metres of depth between pixels that are not of one surface
BLUR = 1.0  # pixels over which noise is averaged
AWAY = 3.0  # metres from the camera to what it looks at
LOOKED_AT = np.array([0.0, 0.85, 0.0])  # metres in the world, whose y is up and whose floor is y = 0
WALL = 1.5  # metres behind it
FARTHEST = 8.0  # metres that the camera measures


@dataclass(frozen=True, slots=True)
class Place:
    """How a camera looks, degrees: down by a pitch, rolled, and from which side; 0 is the first camera's."""

    pitch: float
    roll: float = 0.0
    side: float = 0.0

    @property
    def turn(self) -> Array:
        """Rotation (3, 3) from the camera's axes (x right, y down, z forward) to the world's."""
        side, pitch, roll = np.radians([self.side, self.pitch, self.roll])
        upright = np.diag([1.0, -1.0, -1.0])
        return about(1, side) @ about(0, -pitch) @ upright @ about(2, roll)

    @property
    def to_world(self) -> Array:
        """From the camera's frame to the world's (4, 4), metres."""
        placed = np.eye(4)
        placed[:3, :3], placed[:3, 3] = self.turn, LOOKED_AT - AWAY * self.turn[:, 2]
        return placed


def about(axis: int, angle: float) -> Array:
    """Rotation (3, 3) about one of the axes, radians."""
    turn, (a, b) = np.eye(3), ((axis + 1) % 3, (axis + 2) % 3)
    turn[a, a] = turn[b, b] = np.cos(angle)
    turn[b, a] = np.sin(angle)
    turn[a, b] = -turn[b, a]
    return turn


def pitched_cases(folders: Sequence[Path], count: int) -> list[Case]:
    """A camera pitched by 30 degrees: in a room, rolled too, from behind, and with the person cut out."""
    footages = [read_skinned(folder) for folder in folders]
    surfaces = Surfaces(footages, [read_place(folder) for folder in folders])
    down, rolled = Place(30.0), Place(30.0, roll=15.0)
    return [
        surfaces.seen("pitched by 30 degrees", down, count),
        surfaces.seen("the same, from behind", Place(30.0, side=180.0), count),
        surfaces.seen("the same, rolled by 15", rolled, count),
        surfaces.seen("pitched by 30, cut out", down, count, room=False),
        surfaces.seen("the same, rolled by 15, cut out", rolled, count, room=False),
    ]


def read_place(folder: Path) -> Array:
    """Where the camera of a recording stood: to the world (4, 4)."""
    meta = msgspec.json.decode((folder / "meta.json").read_bytes())
    return np.array(meta["camera"]["camera_to_world"])


class Surfaces:
    """What several cameras saw together of one performance, moment by moment."""

    def __init__(self, footages: Sequence[Footage], places: Sequence[Array]) -> None:
        self._footages, self._places = footages, places
        self._open3d = load_open3d()

    def seen(self, name: str, place: Place, count: int, *, room: bool = True) -> Case:
        """So many frames of it as a camera somewhere sees them, with a floor and a wall or without."""
        first = self._footages[0]
        camera, to_camera = first.frames[0].intrinsics, np.linalg.inv(place.to_world)
        onto, rng = to_camera @ self._places[0], np.random.default_rng(0)
        joints = {n: first.joints[n] @ onto[:3, :3].T + onto[:3, 3] for n in range(count)}
        frames = [measured(n, self._draw(n, place, camera, room=room), camera, rng) for n in range(count)]
        return Case(name, frames, joints, first.names, first.near)

    def _draw(self, moment: int, place: Place, camera: Intrinsics, *, room: bool) -> Array:
        """Depth (H, W) in metres, 0 where nothing is."""
        core, geometry = self._open3d.core, self._open3d.t.geometry
        rays, scene = world_rays(place, camera), geometry.RaycastingScene()
        for footage, stood in zip(self._footages, self._places, strict=True):
            vertices, triangles = sheet(footage.frames[moment])
            vertices = vertices @ stood[:3, :3].T + stood[:3, 3]
            scene.add_triangles(core.Tensor(vertices.astype(np.float32)), core.Tensor(triangles))
        depth: Array = scene.cast_rays(core.Tensor(rays))["t_hit"].numpy().astype(np.float64)
        if room:
            depth = np.minimum(depth, walls(rays))
        return np.where(depth < FARTHEST, depth, 0.0)


def sheet(frame: DepthFrame) -> tuple[Array, NDArray[np.uint32]]:
    """A depth image as a surface: vertices (V, 3) in its camera's frame, metres, and triangles (T, 3)."""
    depth = smooth(frame.metres())
    rows, columns = depth.shape
    corner = np.arange(rows * columns, dtype=np.uint32).reshape(depth.shape)
    quad = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]], axis=-1)
    there = depth.ravel()[quad]
    quad = quad[(there.min(axis=-1) > 0.0) & (np.ptp(there, axis=-1) < JUMP)]
    triangles = np.concatenate([quad[:, [0, 2, 1]], quad[:, [1, 2, 3]]])
    return back_project(depth, frame.intrinsics).reshape(-1, 3), triangles


def smooth(depth: NDArray[np.floating]) -> Array:
    """Depth (H, W) with the noise of its camera averaged away, where there is any."""
    there = depth > 0.0
    middle = np.where(there, median_filter(depth, 5), 0.0)
    near = there & (np.abs(middle - depth) < JUMP)
    share = gaussian_filter(near.astype(np.float64), BLUR)
    mean = gaussian_filter(np.where(near, depth, 0.0).astype(np.float64), BLUR) / np.maximum(share, 1e-6)
    return np.where(near & (np.abs(mean - middle) < JUMP), mean, 0.0)


def world_rays(place: Place, camera: Intrinsics) -> NDArray[np.float32]:
    """A camera's rays (H, W, 6) in the world: from where, and as far as one metre of depth."""
    v, u = np.indices((camera.height, camera.width))
    ahead = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1)
    placed = place.to_world
    origins = np.broadcast_to(placed[:3, 3], ahead.shape)
    return np.concatenate([origins, ahead @ placed[:3, :3].T], axis=-1).astype(np.float32)


def walls(rays: NDArray[np.float32]) -> Array:
    """Depth (H, W) at which rays reach the floor, or a wall behind; infinite where neither."""
    origins, along = rays[..., :3].astype(np.float64), rays[..., 3:].astype(np.float64)
    back = -np.sign(origins[0, 0, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = -origins[..., 1] / along[..., 1]
        wall = (back * WALL - origins[..., 2]) / along[..., 2]
    return np.minimum(np.where(floor > 0.0, floor, np.inf), np.where(wall > 0.0, wall, np.inf))
