"""Evidence that the nearest neighbours of observed points cannot give: where the camera saw nothing."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from worker.evidence import Evidence

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CLOSEST = 0.05  # metres from the camera's plane


@numba.njit(cache=True, nogil=True, error_model="numpy")
def pull_into_silhouette(
    visible: Indices, posed: Array, evidence: Evidence, targets: Array, away: Array
) -> None:
    """How far the visible ones of posed (V, 3) lie from the subject's silhouette, at their own depth.

    Fills targets (V, 3) with the nearest points on the silhouette's cone and away (V,) with their distances
    squared (m^2), in the order of `visible`; 0 where a point projects onto the subject or outside what the
    camera saw.
    """
    seen, nearest = evidence.seen, evidence.nearest
    for m in range(len(visible)):
        x, y, z = posed[visible[m], 0], posed[visible[m], 1], posed[visible[m], 2]
        away[m] = 0.0
        nearer = 1.0 / max(z, CLOSEST)
        u, v = evidence.cx + evidence.fx * x * nearer, evidence.cy + evidence.fy * y * nearer
        column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
        if seen[0] <= column < seen[2] and seen[1] <= row < seen[3] and z > CLOSEST:
            column = min(max(column, 0), nearest.shape[2] - 1)
            row = min(max(row, 0), nearest.shape[1] - 1)
            du, dv = nearest[1, row, column] - u, nearest[0, row, column] - v
            if abs(du) > 1.0 or abs(dv) > 1.0:
                right, down = du * z / evidence.fx, dv * z / evidence.fy
                targets[m, 0], targets[m, 1], targets[m, 2] = x + right, y + down, z
                away[m] = right * right + down * down
