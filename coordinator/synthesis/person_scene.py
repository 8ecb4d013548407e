"""A person who moves fast, recorded by a Kinect ten times per second.

Each seed is a different person, with lengths that differ from the template, and a different motion. Arms move
from one comfortable pose to the next in a quarter to half a second; legs step, kick and bend; the body turns.
The person must be detected and does not move in the first half second.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import msgspec
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

Range = tuple[float, float]


class Shot(msgspec.Struct, frozen=True):
    """How a person is recorded, who it is, and how fast they move."""

    frames: int = 60
    fps: float = 10.0
    camera: Intrinsics = Intrinsics(512, 424, 365.0, 365.0, 255.5, 211.5)
    camera_height_m: float = 1.0  #: above the floor
    distance_m: float = 2.8
    statures_m: Range = (1.6, 1.9)
    girths: Range = (0.9, 1.15)
    length_deviation: float = 0.04  #: of lengths from those of the stature, relative
    arm_moves_s: Range = (0.2, 0.4)
    arm_rests_s: Range = (0.0, 0.2)
    leg_moves_s: Range = (0.3, 0.5)
    leg_rests_s: Range = (0.0, 0.4)
    trunk_moves_s: Range = (0.4, 0.8)
    trunk_rests_s: Range = (0.0, 0.3)
    still_s: float = 0.5  #: before the first motion
    clear_m: float = 0.2  #: least distance of elbow and wrist from the line from pelvis to head
    two_statures_m: Range = (1.82, 1.65)  #: of `two`
    step_s: float = 0.5  #: half a period of a leg in `two`
    step_deg: float = 22.0  #: its swing


SHOT = Shot()

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


def person(seed: int = 0) -> Scene:
    """A scene of a random person; the same seed gives the same person and motion."""
    rng = np.random.default_rng([seed, 2])
    model = random_person(rng)
    times = np.arange(SHOT.frames) / SHOT.fps
    poses = np.zeros((SHOT.frames, len(model.dof_names)))
    for side in "lr":
        keys = through(times[-1], SHOT.arm_moves_s, SHOT.arm_rests_s, rng)
        move(model, poses, times, keys, [draw_arm(model, side, rng) for _ in keys])
    keys = through(times[-1], SHOT.leg_moves_s, SHOT.leg_rests_s, rng)
    move(model, poses, times, keys, [draw_legs(k, rng) for k in range(len(keys))])
    keys = through(times[-1], SHOT.trunk_moves_s, SHOT.trunk_rests_s, rng)
    move(model, poses, times, keys, [draw_from({**TRUNK, **TURN}, "", rng) for _ in keys])
    poses[:, model.dof("root_tz")] = SHOT.distance_m
    return Scene(model, SHOT.camera, SHOT.fps, grounded(model, poses), None)


def grounded(model: BodyModel, poses: Array) -> Array:
    """Poses (F, D) with the lowest point on the floor."""
    placed = poses.copy()
    for pose in placed:
        pose[model.dof("root_ty")] = SHOT.camera_height_m - pose_vertices(model, pose[None])[0, :, 1].max()
    return placed


def random_person(rng: np.random.Generator) -> BodyModel:
    """A person whose lengths vary from those implied by the stature."""
    stature, girth = rng.uniform(*SHOT.statures_m), rng.uniform(*SHOT.girths)
    off = 1.0 + SHOT.length_deviation * np.clip(rng.standard_normal(len(LENGTHS)), -2.0, 2.0)
    usual = Measures.of(stature, girth)
    lengths = dict(zip(LENGTHS, (off * usual.lengths).tolist(), strict=True))
    return human_of(Measures.of(stature, girth, **lengths))


def through(
    end: float, moves: tuple[float, float], rests: tuple[float, float], rng: np.random.Generator
) -> list[tuple[float, float]]:
    """Start and end of successive motions, seconds."""
    spans, now = [], SHOT.still_s
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
        if np.linalg.norm(at[joint] - low - share * axis) < SHOT.clear_m:
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


@cache
def two() -> Scene:
    """A scene of two people, one of whom walks about behind the other; both must be detected."""
    bodies = [human(stature) for stature in SHOT.two_statures_m]
    stands = animate(bodies[0], ARMS_DEG, **STANDS_M)
    walks = animate(bodies[1], HEADING_DEG, **WALKS_M)
    speed = np.hypot(*np.gradient(walks[:, [bodies[1].dof("root_tx"), bodies[1].dof("root_tz")]], axis=0).T)
    phase = np.pi * np.arange(len(walks)) / (SHOT.step_s * DEFAULT_FPS)
    swing = np.radians(SHOT.step_deg) * np.clip(speed / speed.max(), 0.0, 1.0) * np.sin(phase)
    swing_limbs(bodies[1], walks, swing)
    first, second = (
        Scene(body, SHOT.camera, DEFAULT_FPS, grounded(body, poses), None)
        for body, poses in zip(bodies, (stands, walks), strict=True)
    )
    return replace(first, others=(second,))


def swing_limbs(model: BodyModel, poses: Array, swing: Array) -> None:
    """Write the gait of a walking person into poses (F, D): legs and arms swing by angles (F,), radians."""
    for side, sign in (("l", 1.0), ("r", -1.0)):
        poses[:, model.dof(f"{side}_hip_flexion")] = sign * swing
        poses[:, model.dof(f"{side}_knee_flexion")] = np.radians(5.0) + np.maximum(0.0, -sign * swing)
        poses[:, model.dof(f"{side}_shoulder_flexion")] = -sign * swing
        poses[:, model.dof(f"{side}_shoulder_abduct")] = np.radians(12.0)
        poses[:, model.dof(f"{side}_elbow_flexion")] = np.radians(15.0)
