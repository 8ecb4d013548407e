"""Depth: the distances of the observed points from the visible surface of the body.

The surface consists of discs around the vertices, with their normals and areas. The distance d_i of a point
is that from the disc of its closest vertex: from its plane or, beyond its rim, from the rim. Distances from
the vertices themselves would make bodies too small: all points at an outline are on one side of its vertices.
All lengths are in the metric of the noise. Like the correspondences, the normals stay fixed in a step.

Clothes, hair and what people carry are outside of the skin, so the body need not go there: of a point outside
of the surface, the squared distance from the plane has a smaller weight than that of a point inside.

The cost is half the sum of rho(d_i^2), with rho a robust kernel or the identity. If nothing of the body is
visible, all points count as infinitely far.
"""

from __future__ import annotations

import numpy as np

from gepf.common.compiling import numba
from gepf.worker.kernel.terms.robust import robust_cost, robust_weight
from gepf.worker.kernel.vectors import add_scaled
from gepf.worker.kernel.workspace import CameraView, Offsets

TINY = 1e-30  # keeps the weight of a point on the surface defined


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cost(view: CameraView) -> float:
    """Cost of the points of a camera, from the offsets of `find_correspondences`."""
    weight, parameters, offsets = view.weights.depth, view.problem.parameters, view.workspace.search.offsets
    per_outlier, outside, total = parameters.per_outlier_squared, parameters.outside_weight, 0.0
    if weight == 0.0:
        return 0.0
    if len(view.visible) == 0:
        return 0.5 * weight * view.observed.count / per_outlier
    for i in range(view.observed.count):
        total += robust_cost(squared_residual(offsets.heights[i], offsets.beyond[i], outside), per_outlier)
    return 0.5 * weight * total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def linearise(view: CameraView) -> None:
    """Add the target of each observed point to its closest vertex: there its disc touches the point."""
    weight, parameters, targets = view.weights.depth, view.problem.parameters, view.workspace.targets
    if weight == 0.0 or len(view.visible) == 0:
        return
    search, offsets = view.workspace.search, view.workspace.search.offsets
    closest, model, vectors, normals = search.closest, search.model, offsets.vectors, offsets.normals
    fill_pulls(weight, parameters.per_outlier_squared, parameters.outside_weight, offsets)
    along, up, masses, shrink = offsets.pulls[0], offsets.pulls[1], offsets.pulls[2], 1.0 / parameters.stretch
    for i in range(view.observed.count):
        m, mass = np.uint64(closest[i]), np.float64(masses[i])
        x = mass * model[m, 0] + along[i] * vectors[0, i] + up[i] * normals[0, i]
        y = mass * model[m, 1] + along[i] * vectors[1, i] + up[i] * normals[1, i]
        z = mass * model[m, 2] + along[i] * vectors[2, i] + up[i] * normals[2, i]
        add_scaled(targets, m, 1.0, (x, y, shrink * z, mass))  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_pulls(weight: float, per_outlier: float, outside: float, offsets: Offsets) -> None:
    """Fill offsets.pulls.

    With h the height, n the normal, e the offset beyond the rim, and w the weight of h^2, the gradient of
    half d^2 is w h n + e. It is the offset from the target, times the weight d^2 / (h^2 + e^2). As e is a
    share of the vector's part in the plane, the gradient is a sum of the vector and the normal.
    """
    heights, beyond, radii = offsets.heights, offsets.beyond, offsets.radii
    along, up, masses = offsets.pulls[0], offsets.pulls[1], offsets.pulls[2]
    for i in range(len(heights)):
        plane, rim = np.float64(heights[i]) * heights[i], np.float64(beyond[i]) * beyond[i]
        squared = squared_residual(heights[i], beyond[i], outside)
        pull = weight * robust_weight(squared, per_outlier)
        masses[i] = pull * (squared + TINY) / (plane + rim + TINY)
    for i in range(len(heights)):
        pull = weight * robust_weight(squared_residual(heights[i], beyond[i], outside), per_outlier)
        along[i] = pull * beyond[i] / (beyond[i] + radii[i] + TINY)
    for i in range(len(heights)):
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
    offsets, stretch, total = view.workspace.search.offsets, view.problem.parameters.stretch, 0.0
    change = 1.0 / (stretch * stretch) - 1.0
    for i in range(view.observed.count):
        height, beyond = np.float64(offsets.heights[i]), np.float64(offsets.beyond[i])
        part = beyond / (beyond + offsets.radii[i] + TINY)
        z = part * offsets.vectors[2, i] + (1.0 - part) * height * offsets.normals[2, i]
        total += np.sqrt(max(0.0, height * height + beyond * beyond + change * z * z))
    return total
