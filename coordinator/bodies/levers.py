"""Angles that a frame does not show: they are evened out with the frames around.

What the tracker reports of a hidden limb, or of the rotation of an arm whose elbow is straight, is chance.
How far each angle may be off is known frame by frame, and so is how fast people move their joints. The
likeliest angles x (F,) that go with both are those that minimise

    sum_f (x_f - angle_f)^2 / variance_f + sum_f (x_f - x_{f-1})^2 / (SPEED interval_f)^2

Here `variance` is what an angle may be off beyond what it always may: an angle that is known stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

Array = NDArray[np.float64]

SPEED = np.radians(1400.0)
"""Radians a second, one standard deviation: a fast arm. Elbows of throwers reach 2 300 degrees."""

SHOWN = np.radians(20.0)
"""From this bend on of its elbow, an upper arm's rotation is seen."""

LEAST = np.radians(1e-4)
"""Standard deviation of an angle that is known."""
MOST = np.radians(10_000.0)
"""And of one that nothing shows: where that lasts, what was reported is evened out."""

_SHOWN_BY = {
    # angle: the joint whose place shows it, and the one about which that turns
    "shoulder_flexion": ("elbow", "shoulder"),
    "shoulder_abduction": ("elbow", "shoulder"),
    "shoulder_rotation": ("wrist", "elbow"),
    "elbow_flexion": ("wrist", "elbow"),
    "hip_flexion": ("knee", "hip"),
    "hip_abduction": ("knee", "hip"),
    "hip_rotation": ("ankle", "knee"),
    "knee_flexion": ("ankle", "knee"),
    "neck_flexion": ("head", "neck"),
}


def shown_by(angles: Sequence[str], joints: Sequence[str]) -> dict[int, tuple[int, int]]:
    """Of angles that a joint's place shows, by name: that joint, and the one about which it turns."""
    found: dict[int, tuple[int, int]] = {}
    for a, name in enumerate(angles):
        side, _, motion = name.partition("_")
        limb = [f"{side}_{joint}" for joint in _SHOWN_BY.get(motion, ())]
        ends = _SHOWN_BY.get(name, limb)
        if ends and set(ends) <= set(joints):
            found[a] = (joints.index(ends[0]), joints.index(ends[1]))
    return found


def weigh(bend: Array) -> Array:
    """How well a bend (F,), radians, shows the twist: 0 straight or bent backward, 1 at a right angle."""
    weight: Array = np.sin(np.clip(bend, 0.0, 0.5 * np.pi)) ** 2
    return weight


def even_out(angle: Array, variance: Array, interval: Array) -> Array:
    """Angles (F,) with those that are not known taken from the frames around; radians.

    `variance` (F,) is what each may be off; `interval` (F - 1,) the seconds between frames.
    """
    if len(angle) < 2:
        return angle
    weight = 1.0 / np.clip(variance, LEAST**2, MOST**2)
    held = 1.0 / (SPEED * interval) ** 2
    bands = np.zeros((2, len(angle)))
    bands[1] = weight
    bands[1, :-1] += held
    bands[1, 1:] += held
    bands[0, 1:] = -held
    evened = solveh_banded(bands, weight * angle)
    return np.where(variance <= LEAST**2, angle, evened)
