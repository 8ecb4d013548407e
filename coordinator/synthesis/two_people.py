"""Two people before a camera: one moves the arms, the other walks behind them to the other side, and back."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from coordinator.bodies.human.template import human
from coordinator.sources.camera import DEFAULT_FPS
from coordinator.synthesis.person_scene import CAMERA, grounded
from coordinator.synthesis.scenes import Scene, animate

STATURES_M = 1.82, 1.65
Keys = dict[str, dict[int, float]]
STANDS_M: Keys = {"root_tx": {0: -0.1, 179: -0.1}, "root_tz": {0: 2.7, 179: 2.7}}
WALKS_M: Keys = {
    "root_tx": {0: 0.8, 20: 0.8, 80: -0.9, 100: -0.9, 160: 0.8, 179: 0.8},
    "root_tz": {0: 3.2, 20: 3.2, 50: 3.5, 80: 3.2, 100: 3.2, 130: 3.5, 160: 3.2, 179: 3.2},
}
ARMS_DEG: Keys = {
    "root_ry": {0: 0, 60: 25, 120: -25, 179: 0},
    "l_shoulder_flexion": {0: 10, 40: 70, 80: 15, 120: 90, 160: 20, 179: 10},
    "r_shoulder_flexion": {0: 10, 30: 15, 60: 80, 100: 20, 140: 70, 179: 10},
    "l_shoulder_abduct": {0: 15, 40: 40, 80: 15, 179: 15},
    "r_shoulder_abduct": {0: 15, 60: 40, 100: 15, 179: 15},
    "l_elbow_flexion": {0: 20, 40: 60, 80: 20, 120: 80, 179: 20},
    "r_elbow_flexion": {0: 20, 60: 70, 100: 20, 140: 60, 179: 20},
}
HEADING_DEG: Keys = {"root_ry": {0: 0, 10: 0, 22: 75, 78: 75, 102: -75, 158: -75, 170: 0, 179: 0}}
STEP_FRAMES, STEP_DEG = 15.0, 22.0  # half a period of a leg, and its swing


@cache
def two() -> Scene:
    """The scene; both people must be detected."""
    bodies = [human(stature) for stature in STATURES_M]
    stands = animate(bodies[0], ARMS_DEG, **STANDS_M)
    walks = animate(bodies[1], HEADING_DEG, **WALKS_M)
    speed = np.hypot(*np.gradient(walks[:, [bodies[1].dof("root_tx"), bodies[1].dof("root_tz")]], axis=0).T)
    phase = np.pi * np.arange(len(walks)) / STEP_FRAMES
    swing = np.radians(STEP_DEG) * np.clip(speed / speed.max(), 0.0, 1.0) * np.sin(phase)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        walks[:, bodies[1].dof(f"{side}_hip_flexion")] = sign * swing
        walks[:, bodies[1].dof(f"{side}_knee_flexion")] = np.radians(5.0) + np.maximum(0.0, -sign * swing)
        walks[:, bodies[1].dof(f"{side}_shoulder_flexion")] = -sign * swing
        walks[:, bodies[1].dof(f"{side}_shoulder_abduct")] = np.radians(12.0)
        walks[:, bodies[1].dof(f"{side}_elbow_flexion")] = np.radians(15.0)
    first, second = (
        Scene(body, CAMERA, DEFAULT_FPS, grounded(body, poses), None)
        for body, poses in zip(bodies, (stands, walks), strict=True)
    )
    return replace(first, others=(second,))
