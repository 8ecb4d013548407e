"""What is known of a frame before its particles are drawn."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

USUAL_INTERVAL = 1.0 / 30.0  # seconds between frames
LONGEST_MOTION = 0.2  # seconds for which a motion is expected to go on

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """A few of the frame's observed points (P, 3), camera frame, metres; the time since the frame before."""

    points: Array = field(default_factory=lambda: np.empty((0, 3)))
    interval: float = USUAL_INTERVAL  # seconds

    @property
    def motion_time(self) -> float:
        """Seconds by which what moves is moved on."""
        return min(self.interval, LONGEST_MOTION)
