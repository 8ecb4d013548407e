"""Depth: the distances of the observed points from the visible surface of the body.

The surface consists of discs around the vertices, with their normals and areas. The distance of a point is
that from the disc of its closest vertex: from its plane or, beyond its rim, from the rim. Distances from the
vertices themselves would make bodies too small: all points at an outline are on one side of its vertices. All
lengths are in the metric of the noise. Like the correspondences, the normals stay fixed in a step.

The cost is half the sum of rho(d_i), with rho a robust kernel or the square. If nothing of the body is
visible, all points count as infinitely far.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Points
from gepf.common.compiling import numba
from gepf.worker.kernel.terms.robust import robust_cost, robust_weight
from gepf.worker.kernel.vectors import add_scaled
from gepf.worker.kernel.workspace import CameraView, Search


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cost(view: CameraView) -> float:
    """Cost of the points of a camera, from the closest vertices of `find_correspondences`."""
    weight, scale_squared = view.weights.depth, view.problem.parameters.outlier_squared
    search, points, total = view.workspace.search, view.observed.points, 0.0
    if weight == 0.0:
        return 0.0
    if len(view.visible) == 0:
        farthest = scale_squared if scale_squared > 0.0 else np.inf
        return 0.5 * weight * view.observed.count * farthest
    for i in range(view.observed.count):
        dx, dy, dz = offset_from_surface(i, points, search)
        total += robust_cost(dx * dx + dy * dy + dz * dz, scale_squared)
    return 0.5 * weight * total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def linearise(view: CameraView) -> None:
    """Add the target of each observed point to its closest vertex: there its disc touches the point."""
    weight, parameters, observed = view.weights.depth, view.problem.parameters, view.observed
    if weight == 0.0 or len(view.visible) == 0:
        return
    shrink, scale_squared = 1.0 / parameters.stretch, parameters.outlier_squared
    search, targets, points = view.workspace.search, view.workspace.targets, observed.points
    model = search.model
    for i in range(observed.count):
        m = search.closest[i]
        dx, dy, dz = offset_from_surface(i, points, search)
        pull = weight * robust_weight(dx * dx + dy * dy + dz * dz, scale_squared)
        x, y, z = model[m, 0] + dx, model[m, 1] + dy, shrink * (model[m, 2] + dz)
        add_scaled(targets, m, pull, (x, y, z, 1.0))  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def offset_from_surface(i: int, points: Points, search: Search) -> tuple[float, float, float]:
    """Offset of observed point i from the disc of its closest vertex, metres, depth stretched."""
    m, model, discs = search.closest[i], search.model, search.discs
    dx, dy, dz = points[0, i] - model[m, 0], points[1, i] - model[m, 1], points[2, i] - model[m, 2]
    nx, ny, nz, radius = discs[m, 0], discs[m, 1], discs[m, 2], discs[m, 3]
    out = nx * dx + ny * dy + nz * dz
    nx, ny, nz = out * nx, out * ny, out * nz
    ax, ay, az = dx - nx, dy - ny, dz - nz
    aside = ax * ax + ay * ay + az * az
    if aside > radius * radius:
        beyond = np.float32(1.0) - radius / np.sqrt(aside)
        nx, ny, nz = nx + beyond * ax, ny + beyond * ay, nz + beyond * az
    return np.float64(nx), np.float64(ny), np.float64(nz)
