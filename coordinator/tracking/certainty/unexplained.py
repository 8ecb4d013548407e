"""Observed points that no part of the posed body is near, as the surface that they stand for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.frame import SubjectFrame
from common.kinematics.chain import contiguous
from coordinator.tracking.observation import some_points

Array = NDArray[np.float64]

VERTICES = 1_000  # of the body
NEAR = 0.08  # metres from a vertex within which a point is explained


def unexplained_points(posed: Array, subject: SubjectFrame, stretch: float) -> tuple[Array, float]:
    """The points (P, 3) that a posed surface (V, 3) leaves over, metres; square metres that each stands for.

    `stretch`, the lateral over the depth noise, is what distances along the line of sight are multiplied by.
    """
    points, camera = some_points(subject), subject.frame.intrinsics
    if not len(points):
        return points, 0.0
    left = np.empty(len(points), dtype=np.bool_)
    find_left_over(contiguous(points.T), posed[:: max(1, len(posed) // VERTICES)], stretch, left)
    measured, z = int(np.count_nonzero(subject.frame.depth)), points[:, 2]
    area = float(np.mean(z * z)) / (camera.fx * camera.fy) * measured / len(points)
    return points[left], area


@numba.njit(cache=True, nogil=True)
def find_left_over(points: Array, vertices: Array, stretch: float, left: NDArray[np.bool_]) -> None:
    """Fill left (P,): whether a point (3, P) is far from all vertices (V, 3).

    Points come last, so that compiled code takes several at once: faster than to stop at the first near one.
    """
    left[:] = True
    for v in range(len(vertices)):
        keep_far(vertices[v], points, stretch, left)


@numba.njit(cache=True, nogil=True)
def keep_far(vertex: Array, points: Array, stretch: float, left: NDArray[np.bool_]) -> None:
    """Clear left (P,) where points (3, P) are near a vertex (3,)."""
    x, y, z = vertex[0], vertex[1], vertex[2]
    for p in range(points.shape[1]):
        dx, dy, dz = x - points[0, p], y - points[1, p], (z - points[2, p]) * stretch
        left[p] &= dx * dx + dy * dy + dz * dz > NEAR * NEAR
