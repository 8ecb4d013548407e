"""Refinement in this process, without the bus."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings
from coordinator.tracking.refiner import idle
from worker.kernel.icp import refine
from worker.kernel.observation import Observation, observe


class DirectRefiner:
    """Fills the coordinator's port with the worker's kernel, on one core."""

    def __init__(self) -> None:
        self._observation: Observation | None = None

    def publish(self, subject: SubjectFrame) -> None:
        """Keep the frame that later calls of `refine` are about."""
        self._observation = observe(subject)

    def send_ahead(self, subject: SubjectFrame) -> None:
        """There is nobody to send it to."""

    def refine(
        self,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        meanwhile: Callable[[], None] = idle,
    ) -> Refined:
        """Poses (N, D) after their descent."""
        if self._observation is None:
            raise RuntimeError("publish a frame first")
        refined = refine(model, self._observation, poses, settings)
        meanwhile()
        return refined
