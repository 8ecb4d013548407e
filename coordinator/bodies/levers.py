"""Angles that the picture may not show: an upper arm's rotation while the elbow is straight, an ankle's bend.

While the elbow is straight, the forearm lies on the line that the arm turns about, and any rotation explains
the picture as well. What the tracker reports then is chance. Such a twist is carried over from the frames
around, the more so the straighter the elbow: the angles x (F,) that minimise

    sum_f w_f (x_f - twist_f)^2 + stiffness sum_f (x_f - x_{f-1})^2,   w_f = sin(bend_f)^2 agreement_f

since the wrist determines the rotation with a standard deviation in proportion to 1 / sin(bend).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

Array = NDArray[np.float64]

STIFFNESS = np.sin(np.radians(10.0)) ** 2
"""With the elbow bent by 10 degrees, a frame counts as much as either neighbour; bent by 90, 30 times."""

SHOWN = np.radians(20.0)
"""From this bend on a twist is seen."""

LEAST = 1e-6
"""Of a weight: where the joint is straight all the time, what was reported is evened out."""


def weigh(bend: Array) -> Array:
    """How well a bend (F,), radians, shows the twist: 0 straight or bent backward, 1 at a right angle."""
    weight: Array = np.sin(np.clip(bend, 0.0, 0.5 * np.pi)) ** 2
    return weight


def carry_over(twist: Array, shown: Array) -> Array:
    """Twists (F,) with those that nothing shows taken from the frames around; radians.

    `shown` (F,) is how well each is known, from 0 to 1: by the bend that shows it, and less where the
    hypotheses disagree about it.
    """
    weight = np.maximum(shown, LEAST)
    if len(twist) < 2:
        return twist
    bands = np.zeros((2, len(twist)))
    bands[1] = weight + 2.0 * STIFFNESS
    bands[1, [0, -1]] -= STIFFNESS
    bands[0, 1:] = -STIFFNESS
    carried: Array = solveh_banded(bands, weight * twist)
    return carried
