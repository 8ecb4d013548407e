"""Refinement in this process, without the bus."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings
from worker.kernel.icp import refine
from worker.kernel.observation import Observation, observe


@dataclass(frozen=True, slots=True, eq=False)
class DirectRequest:
    """Particles that are refined when their result is asked for."""

    model: BodyModel
    observation: Observation
    poses: NDArray[np.float64]  # (N, D)
    settings: RefineSettings
    covariance: bool

    def result(self) -> Refined:
        """The particles after their descent."""
        return refine(self.model, self.observation, self.poses, self.settings, covariance=self.covariance)


class DirectRefiner:
    """Fills the coordinator's port with the worker's kernel, on one core."""

    def __init__(self) -> None:
        self._observation: Observation | None = None

    def publish(self, subject: SubjectFrame) -> None:
        """Keep the frame that later calls of `submit` are about."""
        self._observation = observe(subject)

    def send_ahead(self, subject: SubjectFrame) -> None:
        """There is nobody to send it to."""

    def submit(
        self,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> DirectRequest:
        """Poses (N, D), to be refined on the frame that was published last."""
        if self._observation is None:
            raise RuntimeError("publish a frame first")
        return DirectRequest(model, self._observation, poses, settings, covariance)
