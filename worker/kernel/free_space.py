"""Free space: model points that lie where the camera saw nothing, which closest points cannot report.

Surfaces that the camera looks along are left out: depth cameras do not measure them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.packing import PackedObservation
from worker.kernel.surface import Surface

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Numbers = NDArray[np.uint32]

CLOSEST = 0.05  # metres from the camera's plane
GRAZING = np.cos(np.radians(78.0))  # between normal and line of sight: beyond it, nothing is measured


@numba.njit(cache=True, nogil=True, error_model="numpy")
def project_onto_silhouette(
    visible: Numbers,
    surface: Surface,
    link_dofs: Indices,
    transforms: Array,
    posed: Array,
    observed: PackedObservation,
    points: Array,
    squared: Array,
) -> None:
    """How far the visible ones of posed (V, 3) lie from the silhouette's nearest ray, at their own depth.

    Fills squared (V,) with the squared distances (m^2), in the order of `visible`, and points (V, 4) with
    what draws a vertex down their slope in the metric of the noise, and how surely its pixel is empty; 0
    where a vertex projects onto the subject or what may hide it, or outside what the camera saw, or where the
    surface is seen from the side.
    """
    nearest, emptiness, fx, fy, cx, cy = (
        observed.nearest,
        observed.emptiness,
        observed.fx,
        observed.fy,
        observed.cx,
        observed.cy,
    )
    left, top, right, bottom = observed.seen[0], observed.seen[1], observed.seen[2], observed.seen[3]
    height, width = emptiness.shape
    stretch_squared = observed.stretch * observed.stretch
    for m in range(len(visible)):
        x, y, z = posed[visible[m], 0], posed[visible[m], 1], posed[visible[m], 2]
        squared[m] = 0.0
        nearer = 1.0 / max(z, CLOSEST)
        u, v = cx + fx * x * nearer, cy + fy * y * nearer
        across, along = u + (0.5 - left), v + (0.5 - top)
        if 0.0 <= across < right - left and 0.0 <= along < bottom - top and z > CLOSEST:
            column, row = left + int(across), top + int(along)
            inside = 0 <= column < width and 0 <= row < height
            weight = emptiness[np.uint64(row), np.uint64(column)] if inside else np.float32(1.0)
            if weight == 0.0:
                continue
            i, j = np.uint64(min(max(row, 0), height - 1)), np.uint64(min(max(column, 0), width - 1))
            du, dv = nearest[1, i, j] - u, nearest[0, i, j] - v
            off = abs(du) > 1.0 or abs(dv) > 1.0
            if off and is_measurable(visible[m], surface, link_dofs, transforms, x, y, z):
                right_by, down_by = du * z / fx, dv * z / fy
                along_ray = right_by * (u + du - cx) / fx + down_by * (v + dv - cy) / fy
                points[m, 0], points[m, 1] = x + right_by, y + down_by
                points[m, 2] = z - along_ray / stretch_squared
                points[m, 3] = weight
                squared[m] = right_by * right_by + down_by * down_by


@numba.njit(cache=True, nogil=True)
def is_measurable(
    v: int, surface: Surface, link_dofs: Indices, transforms: Array, x: float, y: float, z: float
) -> bool:
    """Whether vertex v, which is at (x, y, z), is on a surface that the camera does not look along."""
    t = link_dofs[surface.skin_links[v, 0]]
    nx, ny, nz = surface.normals[v, 0], surface.normals[v, 1], surface.normals[v, 2]
    along = 0.0
    for a in range(3):
        turned = transforms[t, a, 0] * nx + transforms[t, a, 1] * ny + transforms[t, a, 2] * nz
        along += turned * (x if a == 0 else y if a == 1 else z)
    facing: bool = along * along > GRAZING * GRAZING * (x * x + y * y + z * z)
    return facing
