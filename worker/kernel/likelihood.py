"""The log posterior of a pose in a frame: likelihood and prior (step 5).

The paper says only "calculated from the residual error". Here the log posterior of a pose is

    -1/2 (mean over observed points of rho(d_i) + mean over visible model points of rho(f_v) + prior) / T

with the prior of the refinement (see `priors`). With several cameras, each has such means, weighted with its
share of the observed points. d_i is the distance of an observed point from its closest
visible model point. f_v is the distance of a model point in empty space from the silhouette. Both are in
units of the lateral noise. rho is the squared distance or a robust kernel. With soft correspondences, the
mean log density of the points replaces both means. The mean is used instead of the sum because errors of
neighbouring points are correlated: a sum over ten thousand points would leave only one hypothesis.

The refinement maximises the same function, with fixed correspondences and visible points in each step. For
the weight both are computed again at the final pose.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.worker.kernel.correspondence import find_correspondences
from gepf.worker.kernel.observation import PackedObservation, view_of
from gepf.worker.kernel.parameters import KernelParameters
from gepf.worker.kernel.priors import prior_cost
from gepf.worker.kernel.soft import mean_log_density
from gepf.worker.kernel.visibility import pose_body, visible_vertices
from gepf.worker.kernel.weighting import robust_cost, vertices_in_free_space
from gepf.worker.kernel.workspace import Problem, Search, Workspaces, workspace_of


@numba.njit(cache=True, nogil=True, error_model="numpy")
def evaluate(pose: Array, problem: Problem, workspaces: Workspaces) -> tuple[float, float]:
    """Log posterior of pose (D,), and mean distance of the observed points from the model in metres.

    Visible points are computed at this pose.
    """
    skeleton, surface, views, parameters = problem
    cost, density, residual, explained = prior_cost(skeleton, pose, parameters.rest_weight), 0.0, 0.0, 0
    for v in range(len(views.extents)):
        observed, workspace = view_of(views, v), workspace_of(workspaces, views, v)
        if observed.count == 0:
            continue
        share = observed.count / views.total
        pose_body(pose, skeleton, surface, workspace)
        visible = visible_vertices(surface, workspace)
        if len(visible) == 0:  # as if the body were far from all points
            cost += share * (parameters.outlier_squared if parameters.outlier_squared > 0.0 else np.inf)
            continue
        explained += observed.count
        find_correspondences(visible, surface, observed, parameters.stretch, workspace)
        residual += share * mean_distance(observed, parameters, workspace.search)
        if parameters.soft:
            density += share * mean_log_density(surface, observed, parameters, workspace)
        else:
            cost += share * mean_cost(observed, parameters, workspace.search)
            if parameters.free_space:
                free = vertices_in_free_space(visible, skeleton, surface, observed, workspace)
                outside, offsets = 0.0, workspace.offsets
                for n in range(len(free)):
                    squared = offsets[n, 0] ** 2 + offsets[n, 1] ** 2
                    outside += robust_cost(squared, parameters.outlier_squared)
                cost += share * (outside / len(visible))
    if explained == 0:
        return -np.inf, np.inf
    return parameters.independent_points * density - 0.5 * cost * parameters.posterior_scale, residual


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mean_cost(observed: PackedObservation, parameters: KernelParameters, search: Search) -> float:
    """Mean robust cost (m^2) of the observed points, in the metric of the noise."""
    cost, squared = 0.0, search.squared
    for i in range(observed.count):
        cost += robust_cost(np.float64(squared[i]), parameters.outlier_squared)
    return cost / observed.count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mean_distance(observed: PackedObservation, parameters: KernelParameters, search: Search) -> float:
    """Mean distance (m) of the observed points from their model points, without scaled depth.

    If depth is scaled strongly, the difference of large numbers may be negative.
    """
    total, excess = 0.0, 1.0 / parameters.stretch**2 - 1.0
    for i in range(observed.count):
        along = np.float64(observed.points[2, i]) - search.model[search.closest[i], 2]
        total += np.sqrt(max(0.0, search.squared[i] + excess * along * along))
    return total / observed.count
