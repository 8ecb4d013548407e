"""Refine particles by articulated ICP: steps 4a-4d, two or three times, and then step 5.

Closest points hold the model back: iterations lead the same way with ever shorter steps. So preset `default`
over-relaxes each iteration but the last (it goes twice as far) and determines once which points are visible.

Any number of lanes refine the particles of one request together: every lane takes them one by one from a
counter that all share, so that none idles while another has two left. A particle's result depends on its own
pose, the model, the observation and the settings; never on the lane that took it, or on its batch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.bounds import LARGEST, check_work
from common.compiling import numba
from common.kinematics.manifold import clamp_to_limits
from common.refinement import Refined, triangle_size
from common.settings import RefineSettings
from worker.kernel.correspondence import find_correspondences
from worker.kernel.gauss_newton import SolverParameters, fill_covariance_root, minimise, over_relax
from worker.kernel.likelihood import evaluate
from worker.kernel.observation import Observation, PackedObservation, pack_observation
from worker.kernel.parameters import KernelParameters, pack_parameters
from worker.kernel.priors import LIMIT_SHARE
from worker.kernel.shared_counter import take_next
from worker.kernel.soft import fisher_scoring_step
from worker.kernel.surface import Skeleton, Surface, pack_model
from worker.kernel.visibility import repose_visible, update_visibility
from worker.kernel.weighting import accumulate_correspondences, metric_of
from worker.kernel.workspace import Workspace, make_workspace

Array = NDArray[np.float64]


MOST_AT_ONCE = 16  # particles that a lane refines in one call, so that it can react to signals in between


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
def is_valid(pose: Array) -> bool:
    """Whether all values of pose (D,) are numbers that may travel; of others no index could be computed."""
    return bool(np.all(np.abs(pose) <= LARGEST))


@numba.njit(cache=True, nogil=True)
def reject_diverged(before: Array, poses: Array, log_likelihood: Array, residual: Array) -> None:
    """Set poses (N, D) that diverged back to where they began, with a likelihood of zero."""
    for n in range(len(poses)):
        if not (is_valid(poses[n]) and log_likelihood[n] < np.inf and not np.isnan(residual[n])):
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
        last_count = find_correspondences(visible, last_count, surface, observed, workspace)  # 4c
        accumulate_correspondences(visible, skeleton, surface, observed, parameters, workspace)
        minimise(skeleton, pose, transforms, solver, workspace.equations)  # 4d
        if parameters.over_relaxation > 0.0 and k < parameters.icp_iterations - 1:
            over_relax(skeleton, before, parameters.over_relaxation, pose)
            clamp_to_limits(skeleton.single, skeleton.limits, pose)
        if not is_valid(pose):
            return -np.inf, np.inf
    if parameters.soft:
        for _ in range(parameters.icp_iterations):
            fisher_scoring_step(pose, skeleton, surface, observed, parameters, workspace)
            if not is_valid(pose):
                return -np.inf, np.inf
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


class Job(NamedTuple):
    """The particles of a request, which lanes share."""

    skeleton: Skeleton
    surface: Surface
    observed: PackedObservation
    parameters: KernelParameters
    before: Array  # (N, D)
    poses: Array  # (N, D) refined in place
    log_likelihood: Array  # (N,)
    residual: Array  # (N,) metres
    covariance_roots: NDArray[np.float32]  # (N, D (D + 1) / 2); (N, 0) where nobody asks for them
    counter: NDArray[np.int64]  # (1,) the next particle that nobody has taken


def refine(
    model: BodyModel,
    observation: Observation,
    poses: NDArray[np.float64],
    settings: RefineSettings,
    *,
    covariance: bool = False,
) -> Refined:
    """Refine particles, one after another.

    Args:
        model: The body of all particles.
        observation: The frame's observed points, camera frame, metres.
        poses: Particles (N, D) before their descent, metres and radians.
        settings: How to refine.
        covariance: Whether it is asked for, too.

    Returns:
        Poses (N, D), log likelihoods (N,) and mean residuals (N,) in metres, in the order given.

    Raises:
        ProtocolError: The work would not end within any sensible time.
    """
    job = make_job(model, observation, poses, settings, covariance=covariance)
    work_on(job, make_workspace(job.skeleton, job.surface, job.observed))
    return finish(job)


def make_job(
    model: BodyModel,
    observation: Observation,
    poses: NDArray[np.float64],
    settings: RefineSettings,
    *,
    covariance: bool = False,
) -> Job:
    """Pack the particles of a request; arguments and errors as of `refine`."""
    check_work(settings, len(poses), observation.count, len(model.vertices))
    count, dofs = poses.shape
    before = np.array(poses, dtype=np.float64, order="C")  # kernels are compiled for one layout
    return Job(
        *pack_model(model),
        pack_observation(observation, settings),
        pack_parameters(settings),
        before,
        before.copy(),
        np.empty(count),
        np.empty(count),
        np.empty((count, triangle_size(dofs) if covariance else 0), np.float32),
        np.zeros(1, dtype=np.int64),
    )


def work_on(job: Job, workspace: Workspace) -> None:
    """Refine particles that no other lane has taken, until there are no more."""
    while refine_next(
        job.counter,
        MOST_AT_ONCE,
        job.poses,
        job.skeleton,
        job.surface,
        job.observed,
        job.parameters,
        workspace,
        job.log_likelihood,
        job.residual,
        job.covariance_roots,
    ):
        pass


def abandon(job: Job) -> None:
    """Have all lanes stop after the particle that they are at."""
    job.counter[0] = len(job.poses)


def finish(job: Job) -> Refined:
    """What came out, when every lane has returned."""
    reject_diverged(job.before, job.poses, job.log_likelihood, job.residual)
    roots = job.covariance_roots if job.covariance_roots.shape[1] else None
    return Refined(job.poses, job.log_likelihood, job.residual, roots)
