"""Evidence that the nearest neighbours of observed points cannot give: where the camera saw nothing."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from worker.evidence import Evidence

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True, inline="always")
def pull_into_silhouette(posed: Array, m: int, evidence: Evidence, target: Array) -> float:
    """Squared distance (m^2) of model point m of (V, 3) from the subject's silhouette, at its own depth.

    Fills target (3,) with the nearest point on the silhouette's cone. 0 where the point projects onto
    the subject or outside what the camera saw.
    """
    x, y, z = posed[m, 0], posed[m, 1], posed[m, 2]
    if z <= 0.05:
        return 0.0
    u, v = evidence.cx + evidence.fx * x / z, evidence.cy + evidence.fy * y / z
    column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    if not (evidence.seen[0] <= column < evidence.seen[2] and evidence.seen[1] <= row < evidence.seen[3]):
        return 0.0
    column = min(max(column, 0), evidence.depth.shape[1] - 1)
    row = min(max(row, 0), evidence.depth.shape[0] - 1)
    near_row, near_column = evidence.nearest[0, row, column], evidence.nearest[1, row, column]
    du, dv = near_column - u, near_row - v
    if abs(du) <= 1.0 and abs(dv) <= 1.0:
        return 0.0
    target[0] = x + du * z / evidence.fx
    target[1] = y + dv * z / evidence.fy
    target[2] = z
    squared: float = (target[0] - x) ** 2 + (target[1] - y) ** 2
    return squared
