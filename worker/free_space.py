"""Evidence that the nearest neighbours of observed points cannot give: where the camera saw nothing."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def pull_into_silhouette(
    point: Array, depth: NDArray[np.float32], nearest: NDArray[np.int32], view: NDArray[np.int64],
    fx: float, fy: float, cx: float, cy: float, target: Array,
) -> float:
    """Squared distance (m^2) of a model point (3,) from the subject's silhouette, at the point's own depth.

    Fills target (3,) with the nearest point on the silhouette's cone. 0 where the point projects onto
    the subject or outside what the camera saw.
    """
    z = point[2]
    if z <= 0.05:
        return 0.0
    u, v = cx + fx * point[0] / z, cy + fy * point[1] / z
    column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    if not (view[0] <= column < view[2] and view[1] <= row < view[3]):
        return 0.0
    column = min(max(column, 0), depth.shape[1] - 1)
    row = min(max(row, 0), depth.shape[0] - 1)
    near_row, near_column = nearest[0, row, column], nearest[1, row, column]
    du, dv = near_column - u, near_row - v
    if abs(du) <= 1.0 and abs(dv) <= 1.0:
        return 0.0
    target[0] = point[0] + du * z / fx
    target[1] = point[1] + dv * z / fy
    target[2] = z
    return (target[0] - point[0]) ** 2 + (target[1] - point[1]) ** 2


def flatten(camera: Intrinsics) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy for the kernel."""
    return camera.fx, camera.fy, camera.cx, camera.cy
