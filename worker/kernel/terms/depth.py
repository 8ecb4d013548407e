"""Depth: the distances of the observed points from the visible surface of the body.

The surface consists of discs around the vertices, with their normals and areas. The distance d_i of a point
is that from the disc of its closest vertex: from its plane or, beyond its rim, from the rim. Distances from
the vertices themselves would make bodies too small: all points at an outline are on one side of its vertices.
All lengths are in the metric of the noise. Like the correspondences, the normals stay fixed in a step.

Clothes, hair and what people carry are outside of the skin, so the body need not extend to them: the squared
distance from the plane has a smaller weight for a point outside the surface than for a point inside.

The cost is half the sum of rho(d_i^2), with rho a robust kernel or the identity. If nothing of the body is
visible, all points count as infinitely far.
"""

from __future__ import annotations

import numpy as np

from gepf.common.compiling import numba
from gepf.worker.kernel.terms.robust import robust_cost, robust_weight
from gepf.worker.kernel.vectors import add_scaled
from gepf.worker.kernel.workspace import BLOCK, CameraView

TINY = 1e-30  # keeps the weight of a point on the surface defined


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cost(view: CameraView) -> float:
    """Cost of the points of a camera, from the results of `find_correspondences`."""
    weight, parameters, search = view.weights.depth, view.problem.parameters, view.workspace.search
    per_outlier, outside, total = parameters.per_outlier_squared, parameters.outside_weight, 0.0
    if weight == 0.0:
        return 0.0
    if len(view.visible) == 0:
        return 0.5 * weight * view.observed.count / per_outlier  # infinite without a robust kernel
    for i in range(view.observed.count):
        total += robust_cost(squared_residual(search.heights[i], search.beyond[i], outside), per_outlier)
    return 0.5 * weight * total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def linearise(view: CameraView) -> None:
    """Add to the closest vertex of each observed point its target: where the vertex's disc touches the point.

    With h the height, n the normal, e the offset beyond the rim, and w the weight of h^2, the gradient of
    half d^2 is w h n + e. It is the offset from the target, times the weight d^2 / (h^2 + e^2).
    """
    parameters, observed, search = view.problem.parameters, view.observed, view.workspace.search
    if view.weights.depth == 0.0 or len(view.visible) == 0:
        return
    points, closest, model, discs = observed.points, search.closest, search.model, search.discs
    targets, along, up, masses = view.workspace.targets, search.block[0], search.block[1], search.block[2]
    shrink = 1.0 / parameters.stretch
    for first in range(0, observed.count, BLOCK):
        stop = min(first + BLOCK, observed.count)
        fill_pulls(first, stop, view)
        for i in range(stop - first):
            p = np.uint64(first + i)
            m, mass = np.uint64(closest[p]), np.float64(masses[i])
            dx, dy, dz = points[0, p] - model[m, 0], points[1, p] - model[m, 1], points[2, p] - model[m, 2]
            x = mass * model[m, 0] + along[i] * dx + up[i] * discs[m, 0]
            y = mass * model[m, 1] + along[i] * dy + up[i] * discs[m, 1]
            z = mass * model[m, 2] + along[i] * dz + up[i] * discs[m, 2]
            add_scaled(targets, m, 1.0, (x, y, shrink * z, mass))  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_pulls(first: int, stop: int, view: CameraView) -> None:
    """Fill rows of search.block for some points.

    0: the share of the offset from the vertex in the gradient. 1: that of the normal; the gradient is their
    sum, because the offset beyond the rim is a share of the offset's part in the plane. 2: the mass, which is
    the weight of the target. 3: the radii. Each loop fills one row and computes the pull again, so that it
    can be vectorised, like the loops of `measure_offsets`.
    """
    weight, parameters, search = view.weights.depth, view.problem.parameters, view.workspace.search
    per_outlier, outside = parameters.per_outlier_squared, parameters.outside_weight
    heights, beyond = search.heights[first:stop], search.beyond[first:stop]
    along, up, masses, radii = search.block[0], search.block[1], search.block[2], search.block[3]
    for i in range(stop - first):
        radii[i] = search.discs[np.uint64(search.closest[first + i]), 3]
    for i in range(stop - first):
        plane, rim = np.float64(heights[i]) * heights[i], np.float64(beyond[i]) * beyond[i]
        squared = squared_residual(heights[i], beyond[i], outside)
        pull = weight * robust_weight(squared, per_outlier)
        masses[i] = pull * (squared + TINY) / (plane + rim + TINY)
    for i in range(stop - first):
        pull = weight * robust_weight(squared_residual(heights[i], beyond[i], outside), per_outlier)
        along[i] = pull * beyond[i] / (beyond[i] + radii[i] + TINY)
    for i in range(stop - first):
        pull = weight * robust_weight(squared_residual(heights[i], beyond[i], outside), per_outlier)
        up[i] = (pull * (outside if heights[i] > 0.0 else 1.0) - along[i]) * heights[i]


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def squared_residual(height: float, beyond: float, outside: float) -> float:
    """d^2 of a point at a height over the plane of its disc and a distance beyond the rim."""
    h, e = np.float64(height), np.float64(beyond)
    return (outside if h > 0.0 else 1.0) * h * h + e * e


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sum_distances(view: CameraView) -> float:
    """Sum of the distances (m) of the observed points from the surface, without stretched depth."""
    search, points, stretch = view.workspace.search, view.observed.points, view.problem.parameters.stretch
    change, total = 1.0 / (stretch * stretch) - 1.0, 0.0
    for i in range(view.observed.count):
        m, height, beyond = np.uint64(search.closest[i]), np.float64(search.heights[i]), search.beyond[i]
        part = beyond / (beyond + search.discs[m, 3] + TINY)
        ahead = points[2, i] - search.model[m, 2]
        z = part * ahead + (1.0 - part) * height * search.discs[m, 2]
        total += np.sqrt(max(0.0, height * height + np.float64(beyond) * beyond + change * z * z))
    return total
