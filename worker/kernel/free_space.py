"""Evidence that the nearest neighbours of observed points cannot give: where the camera saw nothing.

Surfaces that it looks along say nothing: depth cameras do not measure them, though they are there.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from worker.kernel.evidence import Evidence
from worker.kernel.surface import Surface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Numbers = NDArray[np.uint32]

CLOSEST = 0.05  # metres from the camera's plane
GRAZING = np.cos(np.radians(78.0))  # between normal and line of sight: beyond it, nothing is measured


@numba.njit(cache=True, nogil=True, error_model="numpy")
def pull_into_silhouette(
    visible: Numbers,
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
    nearest, depth, fx, fy, cx, cy = (
        evidence.nearest,
        evidence.depth,
        evidence.fx,
        evidence.fy,
        evidence.cx,
        evidence.cy,
    )
    left, top, right, bottom = evidence.seen[0], evidence.seen[1], evidence.seen[2], evidence.seen[3]
    height, width = depth.shape
    for m in range(len(visible)):
        x, y, z = posed[visible[m], 0], posed[visible[m], 1], posed[visible[m], 2]
        away[m] = 0.0
        nearer = 1.0 / max(z, CLOSEST)
        u, v = cx + fx * x * nearer, cy + fy * y * nearer
        across, along = u + (0.5 - left), v + (0.5 - top)
        if 0.0 <= across < right - left and 0.0 <= along < bottom - top and z > CLOSEST:
            column, row = left + int(across), top + int(along)
            inside = 0 <= column < width and 0 <= row < height
            if inside and depth[np.uint64(row), np.uint64(column)] > 0.0:
                continue
            i, j = np.uint64(min(max(row, 0), height - 1)), np.uint64(min(max(column, 0), width - 1))
            du, dv = nearest[1, i, j] - u, nearest[0, i, j] - v
            off = abs(du) > 1.0 or abs(dv) > 1.0
            if off and faces(visible[m], surface, link_dofs, transforms, x, y, z):
                right_by, down_by = du * z / fx, dv * z / fy
                targets[m, 0], targets[m, 1], targets[m, 2] = x + right_by, y + down_by, z
                away[m] = right_by * right_by + down_by * down_by


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
