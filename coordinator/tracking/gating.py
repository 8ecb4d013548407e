"""Gating: whether a pose is accepted, by its normalised residual."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from gepf.common.settings import SOFT_NOISE_RATIO, RefineSettings
from gepf.coordinator.settings import GatingSettings


@dataclass(frozen=True, slots=True)
class Gate:
    """The normalised residual of a pose, accepted if at most 1. `why` is the main reason against it."""

    normalised_residual: float
    why: str = ""

    @property
    def passes(self) -> bool:
        """Whether the pose is accepted."""
        return self.normalised_residual <= 1.0

    def rejected_for(self, why: str) -> Self:
        """The gate of a pose that is ruled out for another reason; unchanged if `why` is empty."""
        return type(self)(np.inf, self.why or why) if why else self


def gate_pose(
    log_likelihood: float, residual: float, settings: RefineSettings, limits: GatingSettings
) -> Gate:
    """The gate of a pose with this log likelihood and mean residual (metres), at the camera's noise."""
    misfit = 0.0
    # with far more noise in depth than across, the cost does not tell surface in empty space from noise
    if settings.noise_depth <= SOFT_NOISE_RATIO * settings.noise_lateral:
        cost = np.sqrt(max(0.0, -2.0 * log_likelihood)) * settings.likelihood_scale
        misfit = float(cost / np.hypot(limits.max_misfit_m, settings.noise_lateral))
    normalised = max(float(residual) / limits.max_distance_m(settings), misfit)
    if not normalised <= 1.0:
        return Gate(normalised if normalised > 1.0 else np.inf, "the body does not fit the observed points")
    return Gate(normalised)
