"""What is known of a frame before its particles are drawn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

USUAL_INTERVAL = 1.0 / 30.0  # seconds between frames
LONGEST_MOTION = 0.2  # seconds for which a motion is expected to go on

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A few of the frame's observed points (P, 3), camera frame, metres; the time since the frame before.

    `step` (D,) is what is known of the relative motion since then, from encoders: NaN where nothing is.
    """

    points: Array = field(default_factory=lambda: np.empty((0, 3)))
    interval: float = USUAL_INTERVAL  # seconds
    step: Array | None = None

    @property
    def motion_time(self) -> float:
        """Seconds by which what moves is moved on."""
        return min(self.interval, LONGEST_MOTION)

    @property
    def known(self) -> Flags:
        """Which degrees of freedom (D,) are known to move as they do; none of them without encoders."""
        flags: Flags = np.zeros(0, dtype=np.bool_) if self.step is None else np.isfinite(self.step)
        return flags

    def expect(self, velocities: Array, share: float) -> Array:
        """The motion (M, D) of who had these velocities (M, D): a share goes on, and known steps count."""
        motion: Array = share * self.motion_time * velocities
        return motion if self.step is None else np.where(np.isnan(self.step), motion, self.step)
