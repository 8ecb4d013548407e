"""How sure a frame makes the tracker of each joint, as it is reported."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OFF = 0.15  # metres from the true joint, from which on a joint is off
FLAGGED = 0.07  # chance of it from which on a joint is flagged: of those in place, 4 to 5 % are
SUSPECTED = 0.3  # from which on the whole frame is in doubt
PROBABLE = 0.5  # and from which on it rather is than not


@dataclass(frozen=True, slots=True, eq=False)
class Certainty:
    """How sure a frame makes the tracker of each joint (J,); NaN where nobody knows where the body is."""

    seen: Array  # share of the surface around the joint that the frame shows, of what faces the camera
    off_probability: Array  # that it is more than 15 cm off
    deviation: Array  # expected distance from the true joint, one standard deviation, metres


def unknown_certainty(joints: int) -> Certainty:
    """Of a frame of which nobody knows where the body is."""
    return Certainty(*np.full((3, joints), np.nan))
