"""Refinement in this process, without the bus."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.recent import FRAMES_KEPT
from common.refinement import Refined
from common.settings import RefineSettings
from worker.kernel.icp import refine
from worker.kernel.observation import Observation, observe


@dataclass(slots=True, eq=False)
class DirectRequest:
    """Particles that are refined when their result, or whether it is ready, is first requested."""

    model: BodyModel
    observation: Observation
    poses: NDArray[np.float64]  # (N, D)
    settings: RefineSettings
    covariance: bool
    velocity: NDArray[np.float64] | None  # (D,)
    refined: Refined | None = None

    @property
    def is_ready(self) -> bool:
        """Whether the particles are refined; if they are not, they are now, one request at a time."""
        if self.refined is not None:
            return True
        self.result()
        return False

    def result(self) -> Refined:
        """Refine the particles, unless that is done."""
        if self.refined is None:
            self.refined = refine(
                self.model,
                self.observation,
                self.poses,
                self.settings,
                covariance=self.covariance,
                velocity=self.velocity,
            )
        return self.refined

    def cancel(self) -> None:
        """Nothing is under way."""


class DirectRefiner:
    """Implements the coordinator's interface with the worker's kernel, on one core."""

    def __init__(self) -> None:
        self._observe = lru_cache(FRAMES_KEPT)(observe)

    def publish(self, subject: SubjectFrame) -> None:
        """Nothing to do without workers."""

    def submit(
        self,
        subject: SubjectFrame,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
        spare: bool = False,
        velocity: NDArray[np.float64] | None = None,
    ) -> DirectRequest:
        """Keep poses (N, D), to be refined on a frame."""
        del spare
        return DirectRequest(model, self._observe(subject), poses, settings, covariance, velocity)
