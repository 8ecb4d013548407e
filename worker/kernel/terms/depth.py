"""Depth: the distances of the observed points from the visible surface of the body.

The surface consists of discs around the vertices, with their normals and areas. The distance of a point is
that from the disc of its closest vertex: from its plane or, beyond its rim, from the rim. Distances from the
vertices themselves would make bodies too small: all points at an outline are on one side of its vertices. All
lengths are in the metric of the noise. Like the correspondences, the normals stay fixed in a step.

Clothes, hair and what people carry are outside of the skin, so the body need not go there: of a point outside
of the surface, the squared distance from the plane has a smaller weight than that of a point inside.

The cost is half the sum of rho(d_i^2), with rho a robust kernel or the identity. If nothing of the body is
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
    outside = np.float32(view.problem.parameters.outside_weight)
    if weight == 0.0:
        return 0.0
    if len(view.visible) == 0:
        farthest = scale_squared if scale_squared > 0.0 else np.inf
        return 0.5 * weight * view.observed.count * farthest
    for i in range(view.observed.count):
        total += robust_cost(residual_of(i, points, search, outside)[1], scale_squared)
    return 0.5 * weight * total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def linearise(view: CameraView) -> None:
    """Add the target of each observed point to its closest vertex: there its disc touches the point."""
    weight, parameters, observed = view.weights.depth, view.problem.parameters, view.observed
    if weight == 0.0 or len(view.visible) == 0:
        return
    shrink, scale_squared = 1.0 / parameters.stretch, parameters.outlier_squared
    search, targets, points = view.workspace.search, view.workspace.targets, observed.points
    model, outside = search.model, np.float32(parameters.outside_weight)
    for i in range(observed.count):
        m = search.closest[i]
        (dx, dy, dz), squared, share = residual_of(i, points, search, outside)
        pull = weight * share * robust_weight(squared, scale_squared)
        x, y, z = model[m, 0] + dx, model[m, 1] + dy, shrink * (model[m, 2] + dz)
        add_scaled(targets, m, pull, (x, y, z, 1.0))  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def residual_of(
    i: int, points: Points, search: Search, outside: np.float32
) -> tuple[tuple[float, float, float], float, float]:
    """Offset (metres, depth stretched) of observed point i from its target, its d_i^2, and its weight.

    With h the distance from the plane, n the normal, and r the offset beyond the rim, d^2 = w h^2 + r^2. Its
    gradient, w h n + r, is the offset times the weight d^2 / (h^2 + r^2).
    """
    m, model, discs = search.closest[i], search.model, search.discs
    dx, dy, dz = points[0, i] - model[m, 0], points[1, i] - model[m, 1], points[2, i] - model[m, 2]
    nx, ny, nz, radius = discs[m, 0], discs[m, 1], discs[m, 2], discs[m, 3]
    height = nx * dx + ny * dy + nz * dz
    ax, ay, az = dx - height * nx, dy - height * ny, dz - height * nz
    aside, beyond = ax * ax + ay * ay + az * az, np.float32(0.0)
    if aside > radius * radius:
        beyond = np.float32(1.0) - radius / np.sqrt(aside)
    plane, rim, share = height * height, beyond * beyond * aside, np.float32(1.0)
    squared = plane + rim
    if height > np.float32(0.0) and plane > np.float32(0.0):  # a square may underflow
        share = (outside * plane + rim) / squared
        squared, height, beyond = share * squared, height * outside / share, beyond / share
    x, y, z = height * nx + beyond * ax, height * ny + beyond * ay, height * nz + beyond * az
    return (np.float64(x), np.float64(y), np.float64(z)), np.float64(squared), np.float64(share)
