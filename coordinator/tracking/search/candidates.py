"""Which poses of a library look most like what is observed, placed where it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.kinematics.rotations import euler_angles, euler_matrix
from coordinator.tracking.search.library import Library
from coordinator.tracking.search.signature import COLUMNS, ROWS, compare, sign

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Alike:
    """Poses (N, D) in the camera frame, the most alike first, and which of the sizes (N,) suits each."""

    poses: Array
    sizes: NDArray[np.int64]
    apart: Array  # (N,) mean square difference of a cell's depth, metres of the library's body

    def take(self, some: NDArray[np.int64]) -> Alike:
        """Only these, in this order."""
        return Alike(self.poses[some], self.sizes[some], self.apart[some])


def join(parts: Sequence[Alike]) -> Alike:
    """All of them, part by part."""
    return Alike(
        np.concatenate([p.poses for p in parts]),
        np.concatenate([p.sizes for p in parts]),
        np.concatenate([p.apart for p in parts]),
    )


def most_alike(points: Array, library: Library, factors: Sequence[float], roll: float, count: int) -> Alike:
    """The poses of a library that look most like observed points.

    Args:
        points: Observed (P, 3), camera frame, metres.
        library: The poses.
        factors: How many times as large as the library's the body may be.
        roll: By how much the picture is turned before it is compared, radians.
        count: How many poses to give, each with its best factor.
    """
    turn = look_straight(points.mean(axis=0), roll)
    seen = np.ascontiguousarray(points @ turn.T)
    apart, middles = np.empty((len(factors), len(library.poses))), np.empty((len(factors), 3))
    image = np.empty((ROWS, COLUMNS), dtype=np.float32)
    for k, factor in enumerate(factors):
        cells = sign(seen / factor, library.cell, image, middles[k])
        compare(library.cells, library.occupied, image, library.bound, apart[k])
        apart[k] /= cells + library.occupied
    size = np.argmin(apart, axis=0)
    best = apart[size, np.arange(len(size))]
    chosen = least(best, count)
    places = (middles[size[chosen]] - library.middles[chosen]) * np.take(factors, size[chosen])[:, None]
    return Alike(put_at(library.poses[chosen], places @ turn, turn.T), size[chosen], best[chosen])


def least(values: Array, count: int) -> NDArray[np.int64]:
    """Where the least of values (N,) are, ascending: so many, the first of equal ones first, NaN last."""
    if count >= len(values):
        return np.argsort(values, kind="stable")
    among = np.flatnonzero(~(values > np.partition(values, count - 1)[count - 1]))
    order: NDArray[np.int64] = among[np.argsort(values[among], kind="stable")[:count]]
    return order


def look_straight(at: Array, roll: float) -> Array:
    """Rotation (3, 3) of the camera frame after which a point (3,) lies straight ahead, then by `roll`."""
    ahead = at / np.linalg.norm(at)
    across = np.cross([0.0, 1.0, 0.0], ahead)
    across /= np.linalg.norm(across)
    straight = np.stack([across, np.cross(ahead, across), ahead])
    c, s = np.cos(roll), np.sin(roll)
    turned: Array = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ straight
    return turned


def put_at(poses: Array, places: Array, turn: Array) -> Array:
    """Poses (N, D), turned by a rotation (3, 3) and with the root at places (N, 3)."""
    moved = poses.copy()
    moved[:, :3] = places
    for pose in moved:
        pose[3:6] = euler_angles(turn @ euler_matrix(pose[3:6]), pose[3:6])
    return moved
