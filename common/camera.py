"""Pinhole camera: x right, y down, z forward, metres; pixel (u, v) is the centre of column u, row v."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask

NOT_MOVED = np.eye(4)  # T_rig_camera of a camera alone
ROUNDED = 1e-3  # error of a rotation, or a unit vector, that is written with a few digits
STRAIGHT_DOWN = 0.1  # sine of the angle between the line of sight and the vertical


Pinhole = tuple[float, float, float, float]
"""fx, fy, cx, cy in pixels, as compiled code takes them."""


class Intrinsics(msgspec.Struct, frozen=True):
    """Pinhole intrinsics in pixels, without distortion."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def pinhole(self) -> Pinhole:
        """fx, fy, cx, cy."""
        return self.fx, self.fy, self.cx, self.cy

    def crop(self, left: int, top: int, width: int, height: int) -> Intrinsics:
        """Intrinsics of the window that starts at column `left` and row `top`."""
        return Intrinsics(width, height, self.fx, self.fy, self.cx - left, self.cy - top)


def moved(points: Array, transform: Array) -> Array:
    """Points (..., 3) after a rigid transform (4, 4)."""
    after: Array = points @ transform[:3, :3].T + transform[:3, 3]
    return after


def is_rigid(matrix: Array) -> bool:
    """Whether a matrix (4, 4) is a rotation and a translation, up to rounding to a few digits."""
    turn = matrix[:3, :3]
    off = np.abs(turn @ turn.T - np.eye(3)).max() + np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max()
    return bool(off < ROUNDED and np.linalg.det(turn) > 0.0 and np.isfinite(matrix).all())


def rigid(rotation: Array, translation: Array) -> Array:
    """The transform (4, 4) of a rotation (3, 3) and a translation (3,)."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, translation
    return transform


def inverse(transform: Array) -> Array:
    """The inverse (4, 4) of a rigid transform (4, 4)."""
    back = transform[:3, :3].T
    return rigid(back, -back @ transform[:3, 3])


def project(points: NDArray[np.floating], camera: Intrinsics) -> Array:
    """Pixels (..., 2) of camera-frame points (..., 3) with z > 0."""
    z = points[..., 2]
    return np.stack(
        [camera.cx + camera.fx * points[..., 0] / z, camera.cy + camera.fy * points[..., 1] / z], axis=-1
    )


def pixels_at(points: Array, camera: Intrinsics) -> tuple[Indices, Indices, Mask]:
    """Row and column of the pixels nearest to points (N, 3) with z > 0, and which are in the image."""
    column, row = np.rint(project(points, camera)).astype(np.int64).T
    return row, column, (row >= 0) & (row < camera.height) & (column >= 0) & (column < camera.width)


def back_project(depth_m: NDArray[np.floating], camera: Intrinsics) -> Array:
    """Camera-frame points (H, W, 3) of a depth image (H, W) in metres; no depth gives the origin."""
    return points_of(depth_m, camera, np.ones(depth_m.shape, np.bool_)).reshape(*depth_m.shape, 3)


def points_of(depth_m: NDArray[np.floating], camera: Intrinsics, mask: Mask) -> Array:
    """Camera-frame points (N, 3) of the pixels in a mask (H, W) of a depth image (H, W) in metres."""
    v, u = np.nonzero(mask)
    z = depth_m[v, u]
    return np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)


def level_from_camera(up: Array | None) -> Array:
    """The rotation (3, 3) to the axes of the levelled camera: x right, y down, z ahead.

    Args:
        up: Unit vector (3,) away from the ground, camera frame; None if unknown: no rotation.
    """
    if up is None:
        return np.eye(3)
    down = -np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    if np.linalg.norm(ahead) < STRAIGHT_DOWN:  # then the top of the image is ahead
        ahead = np.array([0.0, -1.0, 0.0]) + down[1] * down
    ahead /= np.linalg.norm(ahead)
    return np.stack([np.cross(down, ahead), down, ahead])
