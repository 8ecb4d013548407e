"""Threads that refine the particles of one request side by side; compiled code holds no lock."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.refinement import Refined
from common.settings import RefineSettings
from worker.kernel.icp import Job, abandon, finish, make_job, work_on
from worker.kernel.observation import Observation, pack_observation
from worker.kernel.workspace import Workspace, make_workspace, narrow


@dataclass(frozen=True, slots=True, eq=False)
class KeptWorkspace:
    """The workspace of a lane, and what it was made for."""

    workspace: Workspace
    sizes: tuple[int, ...]  # of the model
    points: int  # padded


class Lanes:
    """A fixed number of lanes: the thread that calls, and threads of our own beside it."""

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError("there must be a lane")
        self.count = count
        self._threads = ThreadPoolExecutor(count)  # which start when they are needed
        self._kept: dict[int, KeptWorkspace] = {}  # by lane, for the next request

    def prepare(self, observation: Observation, settings: RefineSettings) -> None:
        """Do ahead what every request about an observation with such settings needs."""
        pack_observation(observation, settings)

    def refine(
        self,
        model: BodyModel,
        observation: Observation,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> Refined:
        """Refine poses (N, D); arguments, results and errors as of `worker.kernel.icp.refine`.

        What a lane raises, or interrupts it, is raised when all lanes have returned.
        """
        job = make_job(model, observation, poses, settings, covariance=covariance)
        lanes = min(self.count, len(poses))
        others = [self._threads.submit(self._work_on, job, lane) for lane in range(1, lanes)]
        try:
            self._work_on(job, 0)
            for other in others:
                other.result()
        except BaseException:
            abandon(job)
            wait(others)
            raise
        return finish(job)

    def _work_on(self, job: Job, lane: int) -> None:
        """Refine particles that no other lane has taken, in a workspace that fits."""
        kept, sizes, points = self._kept.get(lane), sizes_of(job), job.observed.points.shape[1]
        if kept is None or kept.sizes != sizes or kept.points < points:
            workspace = make_workspace(job.skeleton, job.surface, job.observed)
            kept = self._kept[lane] = KeptWorkspace(workspace, sizes, points)
        work_on(job, narrow(kept.workspace, points))


def sizes_of(job: Job) -> tuple[int, ...]:
    """Degrees of freedom, links, vertices and leaves of a job's model, on which a workspace depends."""
    leaves = int(job.surface.leaves[-1])
    return len(job.skeleton.parents), len(job.skeleton.link_dofs), len(job.surface.vertices), leaves
