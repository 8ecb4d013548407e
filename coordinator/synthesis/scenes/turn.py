"""A person who moves arms and legs and turns, so that the right arm and leg are hidden for a while.

The situation of section 6 of the paper, with truth: 24 degrees of freedom, 180 frames. The right arm comes
out raised where it went in hanging, so that who follows a single pose looks for it in vain.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from common.camera import Intrinsics
from coordinator.bodies.human.template import human
from coordinator.synthesis.scenes.scene import Scene, animate

FRAMES = 180

PLACE_M: dict[str, dict[float, float]] = {
    "root_tx": {0: 0.0, 60: 0.08, 120: -0.06, 179: 0.0},
    "root_ty": {0: -0.01, 179: -0.01},
    "root_tz": {0: 3.3, 60: 3.2, 120: 3.4, 179: 3.3},
}
ANGLES_DEG: dict[str, dict[float, float]] = {
    "root_rx": {0: 0, 60: 4, 120: -2, 179: 0},
    "root_ry": {0: 0, 30: 12, 60: -10, 88: 0, 112: 0, 119: 80, 128: 84, 146: 84, 153: 10, 179: -10},
    "root_rz": {0: 0, 45: 3, 90: -3, 179: 0},
    "l_shoulder_flexion": {0: 10, 25: 65, 50: 20, 80: 60, 110: 10, 140: 50, 179: 15},
    "l_shoulder_abduct": {0: 15, 25: 35, 50: 8, 80: 55, 110: 15, 140: 5, 179: 15},
    "l_shoulder_twisting": {0: 0, 40: 25, 80: -15, 120: 15, 179: 0},
    "l_elbow_flexion": {0: 20, 25: 60, 50: 30, 80: 80, 110: 30, 140: 55, 179: 25},
    "r_shoulder_flexion": {0: 10, 30: 20, 55: 75, 85: 30, 110: 25, 135: -20, 153: 110, 179: 110},
    "r_shoulder_abduct": {0: 15, 30: 60, 55: 20, 85: 50, 110: 15, 135: 4, 153: 40, 179: 40},
    "r_shoulder_twisting": {0: 0, 40: -20, 75: 30, 115: 0, 153: 0, 179: 0},
    "r_elbow_flexion": {0: 25, 30: 60, 55: 85, 85: 40, 110: 30, 135: 22, 153: 100, 179: 100},
    "l_hip_flexion": {14: 0, 32: 40, 57: 0, 80: 35, 98: 0, 114: -12, 128: 9, 146: 15, 160: 26, 179: 0},
    "l_hip_abduct": {0: 4, 32: 12, 62: 4, 80: 14, 110: 2, 179: 4},
    "l_hip_twisting": {0: 0, 32: -12, 62: 0, 80: 10, 120: 0, 179: 0},
    "l_knee_flexion": {14: 5, 32: 60, 57: 5, 80: 55, 98: 5, 114: 20, 128: 14, 146: 20, 160: 25, 179: 5},
    "l_ankle_flexion": {0: 0, 32: -15, 62: 0, 80: 10, 110: 0, 145: 8, 179: 0},
    "r_hip_flexion": {0: 0, 30: 0, 50: 45, 70: 0, 98: -5, 112: 24, 128: 6, 146: 12, 160: -10, 179: 0},
    "r_hip_abduct": {0: 4, 50: 14, 75: 4, 110: 2, 150: 2, 179: 4},
    "r_hip_twisting": {0: 0, 50: 12, 75: 0, 179: 0},
    "r_knee_flexion": {0: 5, 30: 5, 50: 65, 70: 5, 98: 8, 112: 35, 128: 14, 146: 20, 160: 35, 179: 5},
    "r_ankle_flexion": {0: 0, 50: -12, 75: 0, 125: 10, 145: -10, 179: 0},
}


@cache
def turn() -> Scene:
    """Arms and legs move, the body turns by 84 degrees and back; tracking starts from the truth."""
    model = human()
    angles = {dof: {at: float(np.radians(v)) for at, v in curve.items()} for dof, curve in ANGLES_DEG.items()}
    poses = animate(model, {**PLACE_M, **angles}, FRAMES)
    return Scene(model, Intrinsics(512, 512, 790.0, 790.0, 255.5, 255.5), 25.0, poses, poses[0])
