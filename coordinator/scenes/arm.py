"""One arm in front of a still body: four degrees of freedom (section 5 of the paper)."""

from __future__ import annotations

from functools import cache

import numpy as np

from common.camera import Intrinsics
from coordinator.models.human import human
from coordinator.scenes.scene import Scene, animate

FRAMES = 176
MOVING = ("r_shoulder_flexion", "r_shoulder_abduct", "r_shoulder_twisting", "r_elbow_flexion")
STAND = {"root_tx": 0.1, "root_ty": -0.005, "root_tz": 3.08}  # the raised hand stays in the picture
STARTS_OFF = {"r_shoulder_abduct": -50.0}  # degrees, from the truth of the first frame

# Degrees by frame. The arm is close to the body around frames 60 and 105. The elbow is never straight, where
# twisting could not be seen, and abduction stays far from 90, where flexion and twisting turn about one axis.
KEYS: dict[str, dict[float, float]] = {
    "r_shoulder_flexion": {0: 56, 30: 62, 60: -4, 82: 66, 105: 4, 138: 60, 160: 78, 175: 70},
    "r_shoulder_abduct": {0: 26, 28: 62, 60: -1, 82: 32, 105: 0, 134: 62, 158: 22, 175: 30},
    "r_shoulder_twisting": {0: 0, 25: -22, 60: 20, 82: 5, 105: 42, 140: -20, 175: 15},
    "r_elbow_flexion": {0: 48, 30: 80, 60: 34, 82: 52, 105: 96, 136: 40, 175: 70},
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
