"""What takes the place of workers for a tracker: only the answer has to be said."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings
from coordinator.pool.options import PoolStatistics
from coordinator.results.live_results import Outlet
from coordinator.tracking.refiner import Pending
from gepf.direct import DirectRefiner
from tests.support.asked import Asked


@dataclass(frozen=True, slots=True, eq=False)
class Ready:
    """Particles that nobody needs to wait for."""

    refined: Refined

    def result(self) -> Refined:
        """The particles."""
        return self.refined


class StandIn(ABC):
    """Fills the tracker's port; by itself it looks at no frame."""

    statistics = PoolStatistics()

    def publish(self, subject: SubjectFrame) -> None:
        """Look at nothing."""
        del subject

    def send_ahead(self, subject: SubjectFrame) -> None:
        """Have no use for it."""
        del subject

    def submit(
        self,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> Pending:
        """What `answer` makes of it."""
        return self.answer(Asked(model, poses, settings, covariance))

    def listen(self, key: str, on_message: Callable[[bytes], None]) -> None:
        """Hear nothing."""
        del key, on_message

    def speak(self, key: str) -> Outlet:
        """There is no bus."""
        raise NotImplementedError(key)

    @abstractmethod
    def answer(self, asked: Asked) -> Pending:
        """Refine, or do as if."""


class Direct(StandIn):
    """Refines in this process."""

    def __init__(self) -> None:
        self._refiner = DirectRefiner()

    def publish(self, subject: SubjectFrame) -> None:
        """Later requests are about this frame."""
        self._refiner.publish(subject)

    def answer(self, asked: Asked) -> Pending:
        """By the worker's kernel, when the result is asked for."""
        return asked.of(self._refiner)


class Listening(Direct):
    """Notes whether it was asked how sure poses are."""

    def __init__(self) -> None:
        super().__init__()
        self.asked: set[bool] = set()

    def answer(self, asked: Asked) -> Pending:
        """As ever."""
        self.asked.add(asked.covariance)
        return super().answer(asked)
