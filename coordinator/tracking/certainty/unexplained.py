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
    points = np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=1)
    left = np.empty(len(points), dtype=np.bool_)
    find_left_over(points, posed[:: max(1, len(posed) // VERTICES)], stretch, left)
    area = float(np.mean(z * z)) / (camera.fx * camera.fy) * measured / len(pixels)
    return points[left], area


@numba.njit(cache=True, nogil=True)
def find_left_over(points: Array, vertices: Array, stretch: float, left: NDArray[np.bool_]) -> None:
    """Fill left (P,): whether a point (P, 3) is far from all vertices (V, 3)."""
    for p in range(len(points)):
        left[p] = True
        for v in range(len(vertices)):
            x, y = vertices[v, 0] - points[p, 0], vertices[v, 1] - points[p, 1]
            z = (vertices[v, 2] - points[p, 2]) * stretch
            if x * x + y * y + z * z <= NEAR * NEAR:
                left[p] = False
                break
