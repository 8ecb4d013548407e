"""Refine particles by articulated ICP: iterations of steps 4a to 4d, and then step 5.

With soft correspondences the same number of Fisher scoring steps follows; see `terms.soft`.

ICP converges slowly: successive steps have the same direction and become shorter. So preset `default`
over-relaxes every iteration but the last: the pose moves twice as far. It does not test visibility in every
iteration, and ends when a step is small.

Any number of lanes refine the particles of one batch together. Each lane takes the next particle from a
common queue. The result of a particle depends only on its pose, the model, the observation and the settings,
not on the lane or the batch.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices
from gepf.common.body import BodyModel
from gepf.common.bounds import LARGEST, MOST_PIXELS, MOST_WORK
from gepf.common.compiling import numba
from gepf.common.errors import ProtocolError
from gepf.common.kinematics.manifold import clamp_to_limits
from gepf.common.refinement import Particles, PosePrior, Refined, triangle_size
from gepf.common.settings import RefineSettings
from gepf.worker.kernel.correspondence import find_correspondences
from gepf.worker.kernel.gauss_newton import fill_covariance_root, minimise, over_relax
from gepf.worker.kernel.likelihood import evaluate
from gepf.worker.kernel.link_sums import sum_by_link
from gepf.worker.kernel.observation import Observation, pack_views, view_of
from gepf.worker.kernel.parameters import pack_parameters
from gepf.worker.kernel.surface import pack_model
from gepf.worker.kernel.terms import linearise_points
from gepf.worker.kernel.visibility import pose_body, pose_some, visible_vertices
from gepf.worker.kernel.workspace import (
    CameraView,
    Keypoints,
    Problem,
    Workspaces,
    make_workspaces,
    workspace_of,
)


class Batch(NamedTuple):
    """The particles of a request, shared among lanes."""

    problem: Problem
    velocity: Array  # (D,) relative motion per second
    means: Array  # (N, D) of the prior
    poses: Array  # (N, D) refined in place
    log_likelihood: Array  # (N,)
    residual: Array  # (N,) metres
    covariance_roots: NDArray[np.float32]  # (N, D (D + 1) / 2); (N, 0) if not requested


def refine(model: BodyModel, observation: Observation, particles: Particles) -> Refined:
    """Refine particles of a body, one after another.

    `observation` holds the frame's observed points, those of each camera in its own frame, metres. Raises
    ProtocolError if this would take too long.
    """
    batch = pack_batch(model, observation, particles)
    refine_some(batch, iter(range(len(particles.poses))))
    return refined(batch)


def pack_batch(model: BodyModel, observation: Observation, particles: Particles) -> Batch:
    """Pack the particles of a request; arguments and errors are those of `refine`."""
    poses, settings, velocity = particles.poses, particles.settings, particles.velocity
    check_work(settings, len(poses) * len(observation.views), observation.total, len(model.vertices))
    count, dofs = poses.shape
    skeleton, surface = pack_model(model)
    views, parameters = pack_views(observation, settings), pack_parameters(settings, observation.total)
    keypoints = Keypoints(model.keypoint_links, model.keypoint_points)
    mean = np.zeros(dofs) if particles.prior is None else particles.prior.mean
    return Batch(
        Problem(skeleton, surface, views, parameters, keypoints, *pack_prior(model, particles.prior)),
        np.zeros(dofs) if velocity is None else np.array(velocity, dtype=np.float64),
        np.array(np.broadcast_to(mean, poses.shape), dtype=np.float64, order="C"),
        np.array(poses, dtype=np.float64, order="C"),  # kernels are compiled for one layout
        np.empty(count),
        np.empty(count),
        np.empty((count, triangle_size(dofs) if particles.covariance else 0), np.float32),
    )


def check_work(settings: RefineSettings, poses: int, points: int, vertices: int) -> None:
    """ProtocolError if refining this number of poses on this number of points would take too long."""
    each = 2.0 * (points * vertices + MOST_PIXELS)  # with soft correspondences
    work = poses * (1 + settings.icp_iterations) * each
    if work > MOST_WORK:
        raise ProtocolError(f"the request takes up to {work:.0e} steps of work, more than {MOST_WORK:.0e}")


def pack_prior(model: BodyModel, prior: PosePrior | None) -> tuple[Array, Indices]:
    """Precision (D, D) of a prior, (0, 0) without any, and the elimination tree (D,) of equations with it.

    A precision that connects degrees of freedom only with their ancestors keeps the equations branch-sparse.
    Any other precision may connect all degrees of freedom.
    """
    if prior is None:
        return np.empty((0, 0)), model.parents.copy()
    if prior.precision.ndim == 1:
        return np.diag(prior.precision.astype(np.float64)), model.parents.copy()
    precision, parents = np.array(prior.precision, np.float64, order="C"), model.parents.copy()
    sparse = not np.any(precision[~model.related])
    return precision, parents if sparse else np.arange(-1, len(parents) - 1)


def refine_some(batch: Batch, particles: Iterator[int]) -> None:
    """Refine particles of a batch in place until the iterator is exhausted; lanes may share the iterator."""
    problem = batch.problem
    workspaces = make_workspaces(problem.skeleton, problem.surface, problem.views, batch.velocity)
    for n in particles:
        refine_one(n, batch, workspaces)


def refined(batch: Batch) -> Refined:
    """The result of a batch in which all particles are refined."""
    roots = batch.covariance_roots if batch.covariance_roots.shape[1] else None
    return Refined(batch.poses, batch.log_likelihood, batch.residual, roots)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def refine_one(n: int, batch: Batch, workspaces: Workspaces) -> None:
    """Refine particle n of a batch. If it diverges, its pose stays and its likelihood becomes zero."""
    before, pose = batch.poses[n].copy(), batch.poses[n]
    log_likelihood, residual = refine_particle(pose, batch.means[n], batch.problem, workspaces)
    if not (is_valid(pose) and log_likelihood < np.inf and not np.isnan(residual)):
        pose[:], log_likelihood, residual = before, -np.inf, np.inf
    batch.log_likelihood[n], batch.residual[n] = log_likelihood, residual
    if batch.covariance_roots.shape[1] > 0:
        fill_covariance_root(batch.problem, workspaces.shared.equations, batch.covariance_roots[n])


@numba.njit(cache=True, nogil=True)
def refine_particle(
    pose: Array, mean: Array, problem: Problem, workspaces: Workspaces
) -> tuple[float, float]:
    """Refine pose (D,) in place; returns its log posterior, see `likelihood`, and mean residual in metres.

    `mean` (D,) is that of the prior.
    """
    skeleton, views, parameters = problem.skeleton, problem.views, problem.parameters
    clamp_to_limits(skeleton.single, skeleton.limits, pose)
    shared, steps, before = workspaces.shared, parameters.steps, pose.copy()
    shared.equations.information[:] = 0.0
    for k in range(parameters.icp_iterations):
        visible = 0
        shared.equations.links[:] = 0.0
        for v in range(len(views.extents)):
            renew = k % steps.visibility_interval == 0
            visible += correspond(v, renew, pose, problem, workspaces)
        if visible == 0:
            break
        before[:] = pose
        minimise(pose, mean, parameters.icp, problem, shared)  # 4d
        if np.max(np.abs(pose - before)) < steps.settled:
            break
        if steps.over_relaxed and k < parameters.icp_iterations - 1:
            over_relax(skeleton, before, pose)
        if not is_valid(pose):
            return -np.inf, np.inf
    for _ in range(parameters.scoring_iterations):
        score(pose, problem, workspaces)
        minimise(pose, mean, parameters.scoring, problem, shared)
        if not is_valid(pose):
            return -np.inf, np.inf
    return evaluate(pose, mean, problem, workspaces)  # 5


@numba.njit(cache=True, nogil=True)
def correspond(v: int, renew: bool, pose: Array, problem: Problem, workspaces: Workspaces) -> int:
    """Linearise the terms of one camera in pose (D,) for ICP; returns the number of its visible vertices.

    If `renew`, it is computed again which vertices are visible.
    """
    skeleton, surface, views, parameters = (
        problem.skeleton,
        problem.surface,
        problem.views,
        problem.parameters,
    )
    observed, workspace = view_of(views, v), workspace_of(workspaces, views, v)
    visible = workspace.visible[: workspaces.counts[v]]
    if renew:
        pose_body(pose, skeleton, surface, workspace)  # 4a
        visible = visible_vertices(surface, workspace)  # 4b
        workspaces.counts[v] = len(visible)
    else:
        pose_some(visible, pose, skeleton, surface, workspace)
    if len(visible) == 0 or observed.count == 0:
        workspace.sums[:] = 0.0
        return len(visible)
    find_correspondences(visible, surface, observed, parameters.stretch, workspace)  # 4c
    workspace.targets[: len(visible)] = 0.0
    view = CameraView(visible, observed, parameters.closest, problem, workspace)
    linearise_points(view)
    sum_by_link(view)
    return len(visible)


@numba.njit(cache=True, nogil=True)
def score(pose: Array, problem: Problem, workspaces: Workspaces) -> None:
    """Linearise the terms of all cameras in pose (D,) for scoring, which needs no correspondences."""
    views, equations = problem.views, workspaces.shared.equations
    equations.sums[:], equations.links[:] = 0.0, 0.0
    for v in range(len(views.extents)):
        observed, workspace = view_of(views, v), workspace_of(workspaces, views, v)
        pose_body(pose, problem.skeleton, problem.surface, workspace)
        nothing = workspace.visible[:0]
        linearise_points(CameraView(nothing, observed, problem.parameters.posterior, problem, workspace))


@numba.njit(cache=True, nogil=True)
def is_valid(pose: Array) -> bool:
    """Whether all values of pose (D,) are finite and within the limits of messages and indices."""
    return bool(np.all(np.abs(pose) <= LARGEST))
