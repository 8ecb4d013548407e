"""Threads that refine the particles of one request in parallel; compiled code releases the GIL."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, wait

from common.arrays import Array
from common.body import BodyModel
from common.refinement import Refined
from common.settings import RefineSettings
from worker.kernel.icp import pack_batch, refine_some, refined
from worker.kernel.observation import Observation, pack_views


class Lanes:
    """A fixed number of lanes: the calling thread and additional threads."""

    def __init__(self, count: int) -> None:
        if count < 1:
            raise ValueError("at least one lane is required")
        self.count = count
        self._threads = ThreadPoolExecutor(count)  # threads start when they are needed

    def prepare(self, observation: Observation, settings: RefineSettings) -> None:
        """Precompute what requests about an observation with these settings need."""
        pack_views(observation, settings)

    def refine(
        self,
        model: BodyModel,
        observation: Observation,
        poses: Array,
        settings: RefineSettings,
        *,
        covariance: bool = False,
        velocity: Array | None = None,
    ) -> Refined:
        """Refine poses (N, D); arguments, results and errors are those of `worker.kernel.icp.refine`.

        Exceptions and interrupts of a lane are raised when all lanes have returned.
        """
        batch = pack_batch(model, observation, poses, settings, covariance=covariance, velocity=velocity)
        particles = iter(range(len(poses)))  # gives each index to one lane
        lanes = min(self.count, len(poses))
        others = [self._threads.submit(refine_some, batch, particles) for _ in range(1, lanes)]
        try:
            refine_some(batch, particles)
            for other in others:
                other.result()
        except BaseException:
            list(particles)  # none is left for the others
            wait(others)
            raise
        return refined(batch)
