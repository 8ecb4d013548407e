"""Threads that refine the particles of one request side by side; compiled code holds no lock."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from queue import SimpleQueue

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.closing import Closing
from common.refinement import Refined
from common.settings import RefineSettings
from worker.kernel.icp import Job, abandon, finish, make_job, work_on
from worker.kernel.observation import Observation, pack_observation
from worker.kernel.workspace import Workspace, make_workspace, narrow

Work = Callable[[int], None]
"""What a lane does; called with the lane's number."""


Sizes = tuple[int, int, int, int]


class Lanes(Closing):
    """A fixed number of lanes: the thread that calls, and threads of our own beside it.

    A context manager; the threads end with it. They are daemons, so that they never hold up an exit.
    """

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError("there must be a lane")
        self.count = count
        self._orders: list[SimpleQueue[Work | None]] = [SimpleQueue() for _ in range(count - 1)]
        self._ended: SimpleQueue[BaseException | None] = SimpleQueue()
        for lane, orders in enumerate(self._orders, start=1):
            threading.Thread(target=self._obey, args=(lane, orders), name=f"lane-{lane}", daemon=True).start()

    def close(self) -> None:
        """Have the threads end when they have done what they do."""
        for orders in self._orders:
            orders.put(None)

    def run(self, work: Work, lanes: int, stop: Callable[[], None]) -> None:
        """Call `work(lane)` on the first `lanes` lanes at once; return when the last of them has returned.

        What one of them raises is raised here when all have returned. `stop` is called by a lane that fails
        or is interrupted, so that the others return soon.
        """

        def attempt(lane: int) -> None:
            try:
                work(lane)
            except BaseException:
                stop()
                raise

        others = min(lanes, self.count) - 1
        for orders in self._orders[:others]:
            orders.put(attempt)
        failures = [caught(lambda: attempt(0)), *(self._await_one(stop) for _ in range(others))]
        for failure in failures:
            if failure is not None:
                raise failure

    def _await_one(self, stop: Callable[[], None]) -> BaseException | None:
        """Wait for a lane; give what it raised, or what interrupted the wait."""
        interrupt: BaseException | None = None
        while True:
            try:
                raised = self._ended.get()
            except BaseException as error:  # noqa: BLE001 - a signal; the lane is waited for all the same
                interrupt = error
                stop()
            else:
                return interrupt or raised

    def _obey(self, lane: int, orders: SimpleQueue[Work | None]) -> None:
        while (work := orders.get()) is not None:
            self._ended.put(caught(partial(work, lane)))


def caught(call: Callable[[], None]) -> BaseException | None:
    """What a call raises, None if nothing."""
    try:
        call()
    except BaseException as error:  # noqa: BLE001 - a signal, too; who asked raises it again
        return error
    return None


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
        model: BodyModel,
        observation: Observation,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> Refined:
        """Refine poses (N, D); arguments, results and errors as of `worker.kernel.icp.refine`."""
        job = make_job(model, observation, poses, settings, covariance=covariance)
        self._lanes.run(
            lambda lane: work_on(job, self._kept[lane].fitting(job)), len(poses), lambda: abandon(job)
        )
        return finish(job)


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
