"""Refinement in this process, without the bus."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial

from common.body import BodyModel
from common.frame import SubjectFrame
from common.recent import FRAMES_KEPT
from common.refinement import Particles, Refined
from coordinator.tracking.refiner import Refiner
from worker.kernel.icp import refine
from worker.kernel.observation import observe


class DirectRequest:
    """Particles that are refined when their result, or whether it is ready, is first requested."""

    def __init__(self, refine: Callable[[], Refined]) -> None:
        self._refine = refine
        self._refined: Refined | None = None

    @property
    def is_ready(self) -> bool:
        """Whether the particles are refined; if they are not, they are now, one request at a time."""
        was_ready = self._refined is not None
        self.result()
        return was_ready

    def result(self) -> Refined:
        """Refine the particles, unless that is done."""
        self._refined = self._refined or self._refine()
        return self._refined

    def cancel(self) -> None:
        """Nothing is under way."""


class DirectRefiner(Refiner):
    """Refines with the worker's kernel, on one core."""

    def __init__(self) -> None:
        self._observe = lru_cache(FRAMES_KEPT)(observe)

    def publish(self, subject: SubjectFrame) -> None:
        """Nothing to do without workers."""

    def refine(self, subject: SubjectFrame, model: BodyModel, particles: Particles) -> DirectRequest:
        """Keep particles, to be refined on a frame."""
        return DirectRequest(partial(refine, model, self._observe(subject), particles))
