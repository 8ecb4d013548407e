"""A person who moves fast, recorded by a Kinect ten times per second.

Each seed is a different person, with lengths that differ from the template, and a different motion. Arms move
from one comfortable pose to the next in a quarter to half a second; legs step, kick and bend; the body turns.
The person must be detected and does not move in the first half second.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.camera import Intrinsics
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.human.measures import LENGTHS, Measures
from gepf.coordinator.bodies.human.template import human, human_of
from gepf.coordinator.sources.camera import DEFAULT_FPS
from gepf.coordinator.synthesis.scenes import Scene, animate

Ranges = dict[str, tuple[float, float]]

FRAMES, FPS = 60, 10.0
CAMERA = Intrinsics(512, 424, 365.0, 365.0, 255.5, 211.5)
DISTANCE_M, CAMERA_HEIGHT_M = 2.8, 1.0
STATURE_M, GIRTH, LENGTH_DEVIATION = (1.6, 1.9), (0.9, 1.15), 0.04
CLEAR_M = 0.2  # least distance of elbow and wrist from the line from pelvis to head

ARM: Ranges = {
    "shoulder_flexion": (-30, 150), "shoulder_abduct": (-10, 90), "shoulder_twisting": (-45, 60),
    "elbow_flexion": (10, 120),
}  # fmt: skip
LIFTED: Ranges = {
    "hip_flexion": (20, 80), "hip_abduct": (0, 25), "hip_twisting": (-15, 15), "knee_flexion": (10, 90),
}  # fmt: skip
STANDING: Ranges = {"hip_flexion": (0, 5), "hip_abduct": (2, 8), "knee_flexion": (3, 10)}
BENT, BEND = {"hip_flexion": 1.0, "knee_flexion": 1.6, "ankle_flexion": -0.4}, (20.0, 70.0)
TRUNK: Ranges = {"vl3_tilt": (-5, 50), "vl3_roll": (-10, 10), "vl3_torsion": (-15, 15)}
TURN: Ranges = {"root_ry": (-100, 100), "root_rx": (-3, 8)}
AT_EASE = {"shoulder_flexion": 10.0, "shoulder_abduct": 18.0, "elbow_flexion": 20.0}
ARM_MOVES_S, ARM_RESTS_S = (0.2, 0.4), (0.0, 0.2)
LEG_MOVES_S, LEG_RESTS_S = (0.3, 0.5), (0.0, 0.4)
TRUNK_MOVES_S, TRUNK_RESTS_S = (0.4, 0.8), (0.0, 0.3)


def person(seed: int = 0) -> Scene:
    """A scene of a random person; the same seed gives the same person and motion."""
    rng = np.random.default_rng([seed, 2])
    model = random_person(rng)
    times = np.arange(FRAMES) / FPS
    poses = np.zeros((FRAMES, len(model.dof_names)))
    for side in "lr":
        keys = through(times[-1], ARM_MOVES_S, ARM_RESTS_S, rng)
        move(model, poses, times, keys, [draw_arm(model, side, rng) for _ in keys])
    keys = through(times[-1], LEG_MOVES_S, LEG_RESTS_S, rng)
    move(model, poses, times, keys, [draw_legs(k, rng) for k in range(len(keys))])
    keys = through(times[-1], TRUNK_MOVES_S, TRUNK_RESTS_S, rng)
    move(model, poses, times, keys, [draw_from({**TRUNK, **TURN}, "", rng) for _ in keys])
    poses[:, model.dof("root_tz")] = DISTANCE_M
    return Scene(model, CAMERA, FPS, grounded(model, poses), None)


def grounded(model: BodyModel, poses: Array) -> Array:
    """Poses (F, D) with the lowest point on the floor."""
    placed = poses.copy()
    for pose in placed:
        pose[model.dof("root_ty")] = CAMERA_HEIGHT_M - pose_vertices(model, pose[None])[0, :, 1].max()
    return placed


def random_person(rng: np.random.Generator) -> BodyModel:
    """A person whose lengths vary from those implied by the stature."""
    stature, girth = rng.uniform(*STATURE_M), rng.uniform(*GIRTH)
    off = 1.0 + LENGTH_DEVIATION * np.clip(rng.standard_normal(len(LENGTHS)), -2.0, 2.0)
    usual = Measures.of(stature, girth)
    lengths = dict(zip(LENGTHS, (off * usual.lengths).tolist(), strict=True))
    return human_of(Measures.of(stature, girth, **lengths))


def through(
    end: float, moves: tuple[float, float], rests: tuple[float, float], rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Start and end of successive motions, seconds."""
    spans, now = [], 0.5
    while now < end:
        begins = now + rng.uniform(*rests)
        now = begins + rng.uniform(*moves)
        spans.append((begins, now))
    return spans


def draw_arm(model: BodyModel, side: str, rng: np.random.Generator) -> dict[str, float]:
    """A comfortable pose of one arm beside the trunk, degrees."""
    while True:
        drawn = draw_from(ARM, f"{side}_", rng)
        if is_clear(model, drawn, "left" if side == "l" else "right"):
            return drawn


def draw_legs(number: int, rng: np.random.Generator) -> dict[str, float]:
    """A pose of both legs, degrees: alternately one that lifts a leg or bends both, and a standing one."""
    stands = {**draw_from(STANDING, "l_", rng), **draw_from(STANDING, "r_", rng)}
    if number % 2:
        return stands
    bend, which = rng.uniform(*BEND), rng.integers(3)
    if which == 2:
        bent = {f"{side}_{name}": share * bend for side in "lr" for name, share in BENT.items()}
        return {**stands, **bent}
    return {**stands, **draw_from(LIFTED, f"{'lr'[which]}_", rng)}


def draw_from(ranges: Ranges, prefix: str, rng: np.random.Generator) -> dict[str, float]:
    """A random value in each range."""
    return {prefix + name: rng.uniform(low, high) for name, (low, high) in ranges.items()}


def is_clear(model: BodyModel, values_deg: dict[str, float], side: str) -> bool:
    """Whether elbow and wrist are outside the trunk and the head."""
    pose = np.zeros((1, len(model.dof_names)))
    for name, value in values_deg.items():
        pose[0, model.dof(name)] = np.radians(value)
    at = dict(zip(model.joint_names, joint_positions(model, pose)[0], strict=True))
    low, axis = at["pelvis"], at["head"] - at["pelvis"]
    for joint in (f"{side}_elbow", f"{side}_wrist"):
        share = np.clip((at[joint] - low) @ axis / (axis @ axis), 0.0, 1.2)
        if np.linalg.norm(at[joint] - low - share * axis) < CLEAR_M:
            return False
    return True


def move(
    model: BodyModel,
    poses: Array,
    times: Array,
    spans: list[tuple[float, float]],
    goals: list[dict[str, float]],
) -> None:
    """Write motions from goal to goal (degrees) into poses (F, D), with minimum jerk (Flash & Hogan 1985)."""
    for name in sorted({name for goal in goals for name in goal}):
        value = AT_EASE.get(name.partition("_")[2], 0.0)
        curve = np.full(len(times), value)
        for (begins, ends), goal in zip(spans, goals, strict=True):
            to = goal.get(name, 0.0)
            t = np.clip((times - begins) / (ends - begins), 0.0, 1.0)
            curve += (to - value) * (t**3 * (10.0 - 15.0 * t + 6.0 * t**2))
            value = to
        poses[:, model.dof(name)] = np.radians(curve)


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
