"""Refine particles by articulated ICP: steps 4a-4d, two or three times, and then step 5.

Closest points hold the model back: iterations lead the same way with ever shorter steps. So preset `default`
over-relaxes each iteration but the last (it goes twice as far) and determines once which points are visible.

A particle's result depends on its own pose, the model, the observation and the settings; never on the
batch it came in.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.bounds import LARGEST_POSE
from common.compiling import numba
from common.kinematics.limits import clamp_to_limits
from worker.kernel.likelihood import evaluate
from worker.kernel.packing import KernelParameters, PackedObservation
from worker.kernel.search.warm_start import find_correspondences
from worker.kernel.shared_counter import take_next
from worker.kernel.soft.fisher_scoring import fisher_scoring_step
from worker.kernel.solver.covariance import fill_covariance_root
from worker.kernel.solver.gauss_newton import SolverParameters, minimise, over_relax
from worker.kernel.solver.priors import LIMIT_SHARE
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.visibility import repose_visible, update_visibility
from worker.kernel.weighting import accumulate_correspondences, metric_of
from worker.kernel.workspace import Workspace

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def refine_next(  # noqa: PLR0913 compiled code takes arrays
    counter: NDArray[np.int64],
    most: int,
    poses: Array,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
    log_likelihood: Array,
    residual: Array,
    covariance_roots: NDArray[np.float32],
) -> bool:
    """Refine those of poses (N, D) in place that the shared counter gives out, `most` of them at the most.

    Fills log_likelihood (N,), residual (N,) in metres, and covariance_roots (N, D (D + 1) / 2), if they are
    not (N, 0). Returns whether the counter may give out more.
    """
    for _ in range(most):
        n: int = take_next(counter)  # type: ignore[call-arg]
        if n >= len(poses):
            return False
        log_likelihood[n], residual[n] = refine_particle(
            poses[n], skeleton, surface, observed, parameters, workspace
        )
        if covariance_roots.shape[1] > 0:
            fill_covariance_root(
                skeleton, observed.count, parameters, workspace.equations, covariance_roots[n]
            )
    return True


@numba.njit(cache=True, nogil=True)
def reject_diverged(before: Array, poses: Array, log_likelihood: Array, residual: Array) -> None:
    """Set poses (N, D) whose descent diverged back to where they began, with a likelihood of zero."""
    for n in range(len(poses)):
        computed = log_likelihood[n] < np.inf and not np.isnan(residual[n])
        for j in range(poses.shape[1]):
            computed &= abs(poses[n, j]) <= LARGEST_POSE
        if not computed:
            poses[n], log_likelihood[n], residual[n] = before[n], -np.inf, np.inf


@numba.njit(cache=True, nogil=True)
def refine_particle(
    pose: Array,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> tuple[float, float]:
    """Refine pose (D,) in place; returns its log likelihood and mean residual in metres."""
    solver = solver_parameters(parameters, observed.count)
    clamp_to_limits(skeleton.single, skeleton.limits, pose)
    workspace.equations.information[:] = 0.0
    transforms, view = workspace.transforms, workspace.visibility
    last_count, visible, before = 0, view.visible, pose.copy()
    for k in range(parameters.icp_iterations):
        if k % parameters.visibility_interval == 0:
            visible = update_visibility(pose, skeleton, surface, transforms, view)  # 4a, 4b
        else:
            repose_visible(pose, visible, skeleton, surface, transforms, view)
        if len(visible) == 0:
            last_count = 0
            break
        before[:] = pose
        last_count = find_correspondences(visible, last_count, surface, observed, parameters, workspace)  # 4c
        accumulate_correspondences(visible, skeleton, surface, observed, parameters, workspace)
        minimise(skeleton, pose, transforms, solver, workspace.equations)  # 4d
        if parameters.over_relaxation > 0.0 and k < parameters.icp_iterations - 1:
            over_relax(skeleton, before, parameters.over_relaxation, pose)
            clamp_to_limits(skeleton.single, skeleton.limits, pose)
    if parameters.soft:
        for _ in range(parameters.icp_iterations):
            fisher_scoring_step(pose, skeleton, surface, observed, parameters, workspace)
    return evaluate(pose, last_count, skeleton, surface, observed, parameters, workspace)  # 5


@numba.njit(cache=True, nogil=True)
def solver_parameters(parameters: KernelParameters, count: int) -> SolverParameters:
    """What weighs beside `count` observed points in a Gauss-Newton step."""
    return SolverParameters(
        metric_of(parameters),
        parameters.damping + parameters.damping_share * count,
        parameters.rest_weight * count,
        LIMIT_SHARE * count,
        parameters.gauss_newton_iterations,
    )
