"""Evidence that the nearest neighbours of observed points cannot give: where the camera saw nothing.

Surfaces that it looks along say nothing: depth cameras do not measure them, though they are there.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from worker.evidence import Evidence
from worker.surface import Surface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CLOSEST = 0.05  # metres from the camera's plane
GRAZING = np.cos(np.radians(78.0))  # between normal and line of sight: beyond it, nothing is measured


@numba.njit(cache=True, nogil=True, error_model="numpy")
def pull_into_silhouette(
    visible: Indices,
    surface: Surface,
    link_dofs: Indices,
    transforms: Array,
    posed: Array,
    evidence: Evidence,
    targets: Array,
    away: Array,
) -> None:
    """How far the visible ones of posed (V, 3) lie from the subject's silhouette, at their own depth.

    Fills targets (V, 3) with the nearest points on the silhouette's cone and away (V,) with their distances
    squared (m^2), in the order of `visible`; 0 where a point projects onto the subject or outside what the
    camera saw, or where the surface is seen from the side.
    """
    seen, nearest, depth = evidence.seen, evidence.nearest, evidence.depth
    for m in range(len(visible)):
        x, y, z = posed[visible[m], 0], posed[visible[m], 1], posed[visible[m], 2]
        away[m] = 0.0
        nearer = 1.0 / max(z, CLOSEST)
        u, v = evidence.cx + evidence.fx * x * nearer, evidence.cy + evidence.fy * y * nearer
        column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
        if seen[0] <= column < seen[2] and seen[1] <= row < seen[3] and z > CLOSEST:
            inside = 0 <= column < depth.shape[1] and 0 <= row < depth.shape[0]
            if inside and depth[row, column] > 0.0:
                continue
            column = min(max(column, 0), nearest.shape[2] - 1)
            row = min(max(row, 0), nearest.shape[1] - 1)
            du, dv = nearest[1, row, column] - u, nearest[0, row, column] - v
            off = abs(du) > 1.0 or abs(dv) > 1.0
            if off and faces(visible[m], surface, link_dofs, transforms, x, y, z):
                right, down = du * z / evidence.fx, dv * z / evidence.fy
                targets[m, 0], targets[m, 1], targets[m, 2] = x + right, y + down, z
                away[m] = right * right + down * down


@numba.njit(cache=True, nogil=True)
def faces(
    v: int, surface: Surface, link_dofs: Indices, transforms: Array, x: float, y: float, z: float
) -> bool:
    """Whether vertex v, which is at (x, y, z), is on a surface that the camera does not look along."""
    n, t = surface.normals[v], link_dofs[surface.skin_links[v, 0]]
    along = 0.0
    for a in range(3):
        turned = transforms[t, a, 0] * n[0] + transforms[t, a, 1] * n[1] + transforms[t, a, 2] * n[2]
        along += turned * (x if a == 0 else y if a == 1 else z)
    facing: bool = along * along > GRAZING * GRAZING * (x * x + y * y + z * z)
    return facing
