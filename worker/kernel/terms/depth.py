"""Depth: the distances of the observed points from their closest visible model points.

The cost is half the sum of rho(d_i), with d_i in the metric of the noise and rho a robust kernel or the
square. If nothing of the body is visible, all points count as infinitely far.
"""

from __future__ import annotations

import numpy as np

from gepf.common.compiling import numba
from gepf.worker.kernel.terms.robust import robust_cost, robust_weight
from gepf.worker.kernel.vectors import add_scaled
from gepf.worker.kernel.workspace import CameraView


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cost(view: CameraView) -> float:
    """Cost of the points of a camera, from the squared distances of `find_correspondences`."""
    weight, scale_squared = view.weights.depth, view.problem.parameters.outlier_squared
    squared, total = view.workspace.search.squared, 0.0
    if weight == 0.0:
        return 0.0
    if len(view.visible) == 0:
        farthest = scale_squared if scale_squared > 0.0 else np.inf
        return 0.5 * weight * view.observed.count * farthest
    for i in range(view.observed.count):
        total += robust_cost(np.float64(squared[i]), scale_squared)
    return 0.5 * weight * total


@numba.njit(cache=True, nogil=True)
def linearise(view: CameraView) -> None:
    """Add each observed point to the targets of its closest visible vertex."""
    weight, parameters, observed = view.weights.depth, view.problem.parameters, view.observed
    if weight == 0.0 or len(view.visible) == 0:
        return
    shrink, scale_squared = 1.0 / parameters.stretch, parameters.outlier_squared
    search, targets, points = view.workspace.search, view.workspace.targets, observed.points
    for i in range(observed.count):
        pull = weight * robust_weight(np.float64(search.squared[i]), scale_squared)
        x, y, z = np.float64(points[0, i]), np.float64(points[1, i]), points[2, i] * shrink
        add_scaled(targets, search.closest[i], pull, (x, y, z, 1.0))  # type: ignore[call-arg]
