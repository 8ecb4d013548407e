"""Threads that refine the particles of one request in parallel; compiled code releases the GIL."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, wait

from gepf.common.body import BodyModel
from gepf.common.refinement import Particles, Refined
from gepf.worker.kernel.icp import pack_batch, refine_some, refined
from gepf.worker.kernel.observation import Observation


class Lanes:
    """A fixed number of lanes: the calling thread and further threads. Spare particles use only one lane."""

    def __init__(self, count: int) -> None:
        self.count = count
        self._threads = ThreadPoolExecutor(count)  # threads start when they are needed

    def refine(self, model: BodyModel, observation: Observation, particles: Particles) -> Refined:
        """Refine particles; arguments, results and errors are those of `gepf.worker.kernel.icp.refine`.

        Exceptions and interrupts of a lane are raised when all lanes have returned.
        """
        batch, count = pack_batch(model, observation, particles), len(particles.poses)
        indices = iter(range(count))  # gives each particle to one lane
        lanes = 1 if particles.spare else min(self.count, count)
        running = [self._threads.submit(refine_some, batch, indices) for _ in range(1, lanes)]
        try:
            refine_some(batch, indices)
            for lane in running:
                lane.result()
        except BaseException:
            list(indices)  # none is left for other lanes
            wait(running)
            raise
        return refined(batch)
