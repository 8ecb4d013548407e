"""Observed points that no part of the posed body is near, as the surface that they stand for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.frame import SubjectFrame

Array = NDArray[np.float64]

POINTS = 300  # that are looked at
VERTICES = 1_000  # of the body
NEAR = 0.08  # metres from a vertex within which a point is explained


def unexplained_points(posed: Array, subject: SubjectFrame, stretch: float) -> tuple[Array, float]:
    """The points (P, 3) that a posed surface (V, 3) leaves over, metres; square metres that each stands for.

    `stretch`, the lateral over the depth noise, is what distances along the line of sight are multiplied by.
    """
    frame, camera = subject.frame, subject.frame.intrinsics
    measured = int(np.count_nonzero(frame.depth))
    pixels = subject.picked[:: max(1, len(subject.picked) // POINTS)].astype(np.int64)
    if not len(pixels):
        return np.empty((0, 3)), 0.0
    rows, columns = np.divmod(pixels, frame.depth.shape[1])
    z = frame.depth.ravel()[pixels] / frame.depth_scale
    points = np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z])
    left = np.empty(len(z), dtype=np.bool_)
    find_left_over(points, posed[:: max(1, len(posed) // VERTICES)], stretch, left)
    area = float(np.mean(z * z)) / (camera.fx * camera.fy) * measured / len(pixels)
    return np.ascontiguousarray(points[:, left].T), area


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
