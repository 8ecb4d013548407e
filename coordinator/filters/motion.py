"""Motion models: the motion expected until the next frame (step 3), and what a frame tells about it.

A model is chosen by `motion_model`. Its state is the velocities of the hypotheses. Motion that is known from
encoders or colour replaces the expected motion (`Observation.expect`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gepf.common.arrays import Array
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.settings import FilterSettings


class MotionModel(Protocol):
    """A model of the motion between frames; all motion is relative, in radians and metres."""

    def predict(self, past: Belief, interval: float) -> Array:
        """The expected motion (M, D) of the poses of a belief within an interval, seconds."""
        ...

    def update(self, motion: Array, interval: float) -> Array:
        """Velocities (M, D), per second, of hypotheses that moved by `motion` (M, D) within an interval."""
        ...


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """The velocity of the last motion, which decays, so that the end of a swing is not overshot."""

    decay_s: float | None  # time constant; None: no decay

    def predict(self, past: Belief, interval: float) -> Array:
        """The motion at the velocity that is left after the interval."""
        share = 1.0 if self.decay_s is None else np.exp(-interval / self.decay_s)
        motion: Array = share * interval * past.velocities
        return motion

    def update(self, motion: Array, interval: float) -> Array:
        """The mean velocity."""
        return motion / interval


def motion_model(settings: FilterSettings) -> MotionModel:
    """The motion model of the settings."""
    return ConstantVelocity(settings.velocity_time_s)
