"""Refinement of a request's particles on all lanes of this worker at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.refinement import Refined
from common.settings import RefineSettings
from common.sizes import Body
from worker.kernel.job import Job, abandon, finish, make_jobs, work_on
from worker.kernel.observation import Observation
from worker.kernel.packing import pack_observation
from worker.kernel.workspace import Workspace, make_workspace, narrow
from worker.lanes import Lanes

Sizes = tuple[int, int, int, int]


class SideBySide:
    """Refines on lanes, each of which keeps its workspace for the next request."""

    def __init__(self, lanes: Lanes) -> None:
        self._lanes = lanes
        self._kept: list[KeptWorkspace] = [KeptWorkspace() for _ in range(lanes.count)]

    def prepare(self, observation: Observation, settings: RefineSettings) -> None:
        """Do ahead what every request about an observation with such settings needs."""
        pack_observation(observation, settings)

    def refine(
        self,
        body: Body,
        observation: Observation,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> Refined:
        """Refine poses (N, D); arguments, results and errors as of `worker.kernel.job.refine`."""
        jobs = make_jobs(body, observation, poses, settings, covariance=covariance)

        def work(lane: int) -> None:
            for job in jobs.each:
                work_on(job, self._kept[lane].fitting(job))

        self._lanes.run(work, len(poses), lambda: abandon(jobs))
        return finish(jobs)


class KeptWorkspace:
    """The workspace of one lane, made anew when a request needs another or a larger one."""

    def __init__(self) -> None:
        self._sizes: Sizes | None = None
        self._points = self._narrowed_to = 0
        self._workspace: Workspace | None = None
        self._narrowed: Workspace | None = None

    def fitting(self, job: Job) -> Workspace:
        """A workspace for a job's particles."""
        points, sizes = job.observed.points.shape[1], sizes_of(job)
        if self._workspace is None or sizes != self._sizes or points > self._points:
            self._workspace = make_workspace(job.skeleton, job.surface, job.observed)
            self._sizes, self._points, self._narrowed = sizes, points, None
        if self._narrowed is None or points != self._narrowed_to:
            self._narrowed, self._narrowed_to = narrow(self._workspace, points), points
        return self._narrowed


def sizes_of(job: Job) -> Sizes:
    """Degrees of freedom, links, vertices and leaves of a job's model, on which a workspace depends."""
    leaves = int(job.surface.leaves[-1])
    return len(job.skeleton.parents), len(job.skeleton.link_dofs), len(job.surface.vertices), leaves
