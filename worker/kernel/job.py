"""The particles of one request, which any number of lanes refine together.

Every lane takes particles one by one from a counter that all share, so that none idles while another has two
left. A particle's result depends on its own pose, the model, the observation and the settings; never on the
lane that took it, or on who came with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.bounds import check_work
from common.refinement import Refined
from common.settings import RefineSettings
from common.sizes import Body, parts_of
from common.triangles import triangle_size
from worker.kernel.icp import refine_next, reject_diverged
from worker.kernel.observation import Observation
from worker.kernel.packing import KernelParameters, PackedObservation, pack_observation, pack_parameters
from worker.kernel.surface import Skeleton, Surface, pack_model
from worker.kernel.workspace import Workspace, make_workspace

Array = NDArray[np.float64]

MOST_AT_ONCE = 16  # particles that a lane refines in one call, so that it can react to signals in between


class Job(NamedTuple):
    """Particles of one body, which lanes share."""

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


class Jobs(NamedTuple):
    """The particles of a request: a job for each of their bodies, which hold parts of what is refined."""

    each: list[Job]
    refined: Refined


def refine(
    body: Body,
    observation: Observation,
    poses: NDArray[np.float64],
    settings: RefineSettings,
    *,
    covariance: bool = False,
) -> Refined:
    """Refine particles, one after another.

    Args:
        body: Of all particles, or of each.
        observation: The frame's observed points, camera frame, metres.
        poses: Particles (N, D) before their descent, metres and radians.
        settings: How to refine.
        covariance: Whether it is asked for, too.

    Returns:
        Poses (N, D), log likelihoods (N,) and mean residuals (N,) in metres, in the order given.

    Raises:
        ProtocolError: The work would not end within any sensible time.
    """
    jobs = make_jobs(body, observation, poses, settings, covariance=covariance)
    for job in jobs.each:
        work_on(job, make_workspace(job.skeleton, job.surface, job.observed))
    return finish(jobs)


def make_jobs(
    body: Body,
    observation: Observation,
    poses: NDArray[np.float64],
    settings: RefineSettings,
    *,
    covariance: bool = False,
) -> Jobs:
    """Pack the particles of a request; arguments and errors as of `refine`."""
    observed, parameters = pack_observation(observation, settings), pack_parameters(settings)
    before = np.array(poses, dtype=np.float64, order="C")  # kernels are compiled for one layout
    roots = np.empty((len(poses), triangle_size(poses.shape[1]) if covariance else 0), np.float32)
    refined = Refined(
        before.copy(), np.empty(len(poses)), np.empty(len(poses)), roots if covariance else None
    )
    jobs = []
    for model, start, stop in parts_of(body, len(poses)):
        check_work(settings, poses.shape, observation.count, len(model.vertices))
        particles = slice(start, stop)
        jobs.append(
            Job(
                *pack_model(model),
                observed,
                parameters,
                before[particles],
                refined.poses[particles],
                refined.log_likelihood[particles],
                refined.residual[particles],
                roots[particles],
                np.zeros(1, dtype=np.int64),
            )
        )
    return Jobs(jobs, refined)


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


def abandon(jobs: Jobs) -> None:
    """Have all lanes stop after the particle that they are at."""
    for job in jobs.each:
        job.counter[0] = len(job.poses)


def finish(jobs: Jobs) -> Refined:
    """What came out, when every lane has returned."""
    for job in jobs.each:
        reject_diverged(job.before, job.poses, job.log_likelihood, job.residual)
    return jobs.refined
