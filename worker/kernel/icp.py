"""Refine particles by articulated ICP: steps 4a-4d, two or three times, and then step 5.

Closest points hold the model back: iterations lead the same way with ever shorter steps. So preset `default`
over-relaxes each iteration but the last (it goes twice as far) and determines once which points are visible.

A particle's result depends on its own pose, the model, the observation and the settings; never on the
batch it came in.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.bounds import LARGEST_POSE, check_work
from common.kinematics.chain import forward_kinematics, motion_axes
from common.refinement import Refined
from common.settings import RefineSettings
from worker.kernel.likelihood import evaluate
from worker.kernel.observation import Observation
from worker.kernel.packing import KernelParameters, PackedObservation, pack_observation, pack_parameters
from worker.kernel.soft.fisher_scoring import fisher_scoring_step
from worker.kernel.soft.responsibilities import sample_distance
from worker.kernel.soft.samples import SampleGrid, sample
from worker.kernel.solver.gauss_newton import SolverParameters, minimise, over_relax
from worker.kernel.solver.priors import clamp_to_limits
from worker.kernel.surface import Skeleton, Surface, pack_model
from worker.kernel.visibility import pose_surface, repose_visible, update_visibility
from worker.kernel.warm_start import find_correspondences
from worker.kernel.weighting import accumulate_correspondences
from worker.kernel.workspace import Workspace, make_workspace

Array = NDArray[np.float64]

BATCH_SIZE = 16  # particles refined in one call, so that a worker can react to signals in between


def refine(
    model: BodyModel, observation: Observation, poses: NDArray[np.float64], settings: RefineSettings
) -> Refined:
    """Refine particles.

    Args:
        model: The body.
        observation: The frame's observed points, camera frame, metres.
        poses: Particles (N, D) before their descent, metres and radians.
        settings: How to refine.

    Returns:
        Poses (N, D), log likelihoods (N,) and mean residuals (N,) in metres, in the order given.

    Raises:
        ProtocolError: The work would not end within any sensible time.
    """
    check_work(settings, poses.shape, observation.count, len(model.vertices))
    skeleton, surface = pack_model(model)
    observed, parameters = pack_observation(observation, settings), pack_parameters(settings)
    workspace = make_workspace(skeleton, surface, observed)
    before = np.array(poses, dtype=np.float64, order="C")  # kernels are compiled for one layout
    refined, log_likelihood, residual = before.copy(), np.empty(len(poses)), np.empty(len(poses))
    for first in range(0, len(poses), BATCH_SIZE):
        some = slice(first, first + BATCH_SIZE)
        refine_batch(
            refined[some],
            skeleton,
            surface,
            observed,
            parameters,
            workspace,
            log_likelihood[some],
            residual[some],
        )
    reject_diverged(before, refined, log_likelihood, residual)
    return Refined(refined, log_likelihood, residual)


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
def refine_batch(
    poses: Array,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
    log_likelihood: Array,
    residual: Array,
) -> None:
    """Refine poses (N, D) in place; fills log_likelihood (N,) and residual (N,) in metres."""
    for n in range(len(poses)):
        log_likelihood[n], residual[n] = refine_particle(
            poses[n], skeleton, surface, observed, parameters, workspace
        )


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
    metric = np.array([1.0, 1.0, parameters.stretch * parameters.stretch])
    damping = parameters.damping + parameters.damping_share * observed.count
    if parameters.keep_limits:
        clamp_to_limits(skeleton, pose)
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
        unexplained = accumulate_correspondences(visible, skeleton, surface, observed, parameters, workspace)
        stiffness = parameters.rest_weight * unexplained
        solver = SolverParameters(
            metric, damping, stiffness, parameters.gauss_newton_iterations, parameters.keep_limits
        )
        minimise(skeleton, pose, solver, workspace.equations)  # 4d
        if parameters.over_relaxation > 0.0 and k < parameters.icp_iterations - 1:
            over_relax(skeleton, before, parameters.over_relaxation, pose)
            if parameters.keep_limits:
                clamp_to_limits(skeleton, pose)
    if parameters.soft:
        for _ in range(parameters.icp_iterations):
            grid = sample_pose(pose, skeleton, surface, parameters, workspace)
            fisher_scoring_step(
                pose, grid, skeleton, observed, parameters, workspace.soft, workspace.equations
            )
    return evaluate(pose, last_count, skeleton, surface, observed, parameters, workspace)  # 5


@numba.njit(cache=True, nogil=True)
def sample_pose(
    pose: Array, skeleton: Skeleton, surface: Surface, parameters: KernelParameters, workspace: Workspace
) -> SampleGrid:
    """Samples of the visible surface in the pose; fills the axes of motion of workspace.equations, too."""
    forward_kinematics(
        skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, workspace.transforms
    )
    pose_surface(surface, workspace.transforms, skeleton.link_dofs, workspace.visibility.posed)
    sums = workspace.equations
    motion_axes(
        skeleton.parents, skeleton.axes, skeleton.points, skeleton.balls, workspace.transforms, sums.w, sums.q
    )
    return sample(workspace.visibility, surface, sample_distance(parameters), workspace.samples)
