"""The port through which the tracker has particles refined. The runtime fills it with the bus."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings


def idle() -> None:
    """Do nothing."""


class Refiner(Protocol):
    """Refines particles on the frame that was published last."""

    def publish(self, subject: SubjectFrame) -> None:
        """Make a frame known to the workers; all later calls of `refine` are about it."""
        ...

    def send_ahead(self, subject: SubjectFrame) -> None:
        """Let the workers have a frame that is to be published next; `refine` stays with the one before."""
        ...

    def refine(
        self,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        meanwhile: Callable[[], None] = idle,
    ) -> Refined:
        """Poses (N, D) after their descent, with likelihood and residual, in the order given.

        `meanwhile` is called once while the workers are busy. A deadline may leave some particles
        unanswered, but not all of them.
        """
        ...
