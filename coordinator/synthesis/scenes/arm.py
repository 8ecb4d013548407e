"""One arm in front of a still body: four degrees of freedom (section 5 of the paper)."""

from __future__ import annotations

from functools import cache

import numpy as np

from common.camera import Intrinsics
from coordinator.bodies.human.template import human
from coordinator.synthesis.scenes.scene import Scene, animate

FRAMES = 176
MOVING = ("r_shoulder_flexion", "r_shoulder_abduct", "r_shoulder_twisting", "r_elbow_flexion")
STAND = {"root_tx": 0.1, "root_ty": 0.04, "root_tz": 3.21}  # the raised hand stays in the picture
STARTS_OFF = {"r_shoulder_abduct": -50.0}  # degrees, from the truth of the first frame

# Degrees by frame. The forearm is close to the body, its hand at the head, around frames 60 and 105. The
# upper arm never comes back to where a lone particle gets stuck, inside the trunk. The elbow is never
# straight, where twisting could not be seen, and abduction stays far from 90, where flexion and twisting turn
# about one axis.
KEYS: dict[str, dict[float, float]] = {
    "r_shoulder_flexion": {0: 56, 32: 62, 60: 104, 82: 90, 105: 117, 142: 60, 175: 78},
    "r_shoulder_abduct": {0: 26, 28: 62, 60: 6, 82: 46, 105: 10, 136: 68, 160: 34, 175: 30},
    "r_shoulder_twisting": {0: 0, 25: -22, 60: 8, 82: -16, 105: 36, 142: -26, 175: 5},
    "r_elbow_flexion": {0: 48, 30: 76, 60: 112, 82: 66, 105: 112, 138: 48, 175: 70},
}


@cache
def arm() -> Scene:
    """A standing person swings the right arm; tracking starts 50 degrees off in one shoulder angle."""
    model = human()
    keys = {
        name: {at: float(np.radians(value)) for at, value in curve.items()} for name, curve in KEYS.items()
    }
    poses = animate(model, keys, FRAMES)
    for name, value in STAND.items():
        poses[:, model.dof(name)] = value
    start = poses[0].copy()
    for name, degrees in STARTS_OFF.items():
        start[model.dof(name)] += np.radians(degrees)
    return Scene(model, Intrinsics(512, 512, 790.0, 790.0, 255.5, 255.5), 25.0, poses, start)
