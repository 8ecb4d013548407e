"""Motions at 30 frames per second in a textured room, in which limbs are hard to see in depth.

`arms`: fast arms in front of the trunk. `wall`: arms beside the body, along a wall close behind it. `back`:
the same motion as in `arms`, seen from behind. `embrace`: two people who embrace each other. The same seed
gives the same people and motions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.kinematics import joint_positions
from gepf.coordinator.sources.camera import DEFAULT_FPS
from gepf.coordinator.synthesis.person_scene import (
    SHOT,
    Ranges,
    draw_arm,
    draw_from,
    grounded,
    move,
    random_person,
    through,
)
from gepf.coordinator.synthesis.scenes import Scene
from gepf.coordinator.synthesis.surround import Room, furnished

Goal = Callable[[BodyModel, str, np.random.Generator], dict[str, float]]


class Gestures(msgspec.Struct, frozen=True):
    """Lengths of time, places, and distances between bodies and walls."""

    seconds: float = 4.0
    arm_moves_s: tuple[float, float] = (0.25, 0.4)
    wall_m: float = 0.22  #: from the middle of the body
    room_m: float = 2.2  #: from the person to the other walls
    in_front_m: tuple[float, float] = (0.14, 0.3)  #: of a wrist from the axis of the trunk
    aside_m: float = 0.18  #: largest distance of such a wrist to the side
    apart_m: float = 0.75  #: of each of two people from the middle, before they embrace
    embraced_m: float = 0.17  #: the same while they do
    embrace_s: tuple[float, float, float, float] = (0.6, 1.6, 3.0, 4.0)  #: approach, arrive, part, gone


GESTURES = Gestures()
IN_FRONT: Ranges = {
    "shoulder_flexion": (-10, 70), "shoulder_abduct": (-15, 30), "shoulder_twisting": (-20, 80),
    "elbow_flexion": (60, 130),
}  # fmt: skip
BACK_DEG, SIDEWAYS_DEG = 180.0, 90.0
HUGS_DEG = (
    {"shoulder_flexion": 85.0, "shoulder_abduct": 25.0, "shoulder_twisting": 70.0, "elbow_flexion": 70.0},
    {"shoulder_flexion": 45.0, "shoulder_abduct": 35.0, "shoulder_twisting": 60.0, "elbow_flexion": 75.0},
)
"""Of the arms of the first person, over the shoulders, and of the second, around the trunk."""


def arms(seed: int) -> Scene:
    """Fast arms in front of the trunk."""
    return in_room(gestures(seed, draw_arm_in_front), GESTURES.room_m)


def back(seed: int) -> Scene:
    """The same, seen from behind."""
    return in_room(gestures(seed, draw_arm_in_front, heading_deg=BACK_DEG), GESTURES.room_m)


def wall(seed: int) -> Scene:
    """Fast arms beside the body, close to the wall behind it."""
    return in_room(gestures(seed, draw_arm), GESTURES.wall_m)


def embrace(seed: int) -> Scene:
    """Two people who walk up to each other, embrace, and part, seen from the side."""
    rng, times = np.random.default_rng([seed, 3]), np.arange(times_of(5.0)) / DEFAULT_FPS
    starts, arrives, parts, gone = GESTURES.embrace_s
    near = ramp(times, starts, arrives) - ramp(times, parts, gone)
    apart = GESTURES.apart_m + near * (GESTURES.embraced_m - GESTURES.apart_m)
    people = list[Scene]()
    for sign, hug in zip((-1.0, 1.0), HUGS_DEG, strict=True):
        model = random_person(rng)
        poses = np.zeros((len(times), len(model.dof_names)))
        spans = [(starts + 0.3, arrives + 0.2), (parts - 0.2, gone - 0.3)]
        for side in "lr":
            goal = {f"{side}_{name}": degrees for name, degrees in hug.items()}
            rest = {f"{side}_{name}": 10.0 for name in hug}
            move(model, poses, times, spans, [goal, rest])
        poses[:, model.dof("root_tx")] = sign * apart
        poses[:, model.dof("root_tz")] = SHOT.distance_m
        poses[:, model.dof("root_ry")] = np.radians(sign * SIDEWAYS_DEG)
        people.append(Scene(model, SHOT.camera, DEFAULT_FPS, grounded(model, poses), None))
    return in_room(replace(people[0], others=(people[1],)), GESTURES.room_m)


def gestures(seed: int, goal: Goal, heading_deg: float = 0.0) -> Scene:
    """A random person who stands and moves both arms from goal to goal."""
    rng = np.random.default_rng([seed, 2])
    model, times = random_person(rng), np.arange(times_of(GESTURES.seconds)) / DEFAULT_FPS
    poses = np.zeros((len(times), len(model.dof_names)))
    for side in "lr":
        keys = through(times[-1], GESTURES.arm_moves_s, SHOT.arm_rests_s, rng)
        move(model, poses, times, keys, [goal(model, side, rng) for _ in keys])
    poses[:, model.dof("root_tz")] = SHOT.distance_m
    poses[:, model.dof("root_ry")] = np.radians(heading_deg)
    return Scene(model, SHOT.camera, DEFAULT_FPS, grounded(model, poses), None)


def times_of(seconds: float) -> int:
    """The number of frames in a time."""
    return round(seconds * DEFAULT_FPS)


def ramp(times: Array, begins: float, ends: float) -> Array:
    """From 0 to 1 between two times, with minimum jerk."""
    t = np.clip((times - begins) / (ends - begins), 0.0, 1.0)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))


def draw_arm_in_front(model: BodyModel, side: str, rng: np.random.Generator) -> dict[str, float]:
    """A pose of one arm with the forearm in front of the trunk, degrees."""
    while True:
        drawn = draw_from(IN_FRONT, f"{side}_", rng)
        pose = np.zeros((1, len(model.dof_names)))
        for name, value in drawn.items():
            pose[0, model.dof(name)] = np.radians(value)
        at = dict(zip(model.joint_names, joint_positions(model, pose)[0], strict=True))
        wrist = at[f"{'left' if side == 'l' else 'right'}_wrist"] - at["pelvis"]
        near, far = GESTURES.in_front_m
        if near < -wrist[2] < far and abs(wrist[0]) < GESTURES.aside_m:
            return drawn


def in_room(scene: Scene, wall_m: float) -> Scene:
    """The scene in a room whose back wall is so far behind the middle of the first person."""
    moved = furnished(scene, Room(wall_m=GESTURES.room_m))
    assert moved.room is not None
    corners, triangles = moved.room
    at_back = corners[:, 2] == corners[:, 2].max()
    corners = corners.copy()
    corners[at_back, 2] += wall_m - GESTURES.room_m
    return replace(moved, room=(corners, triangles))


SCENES: dict[str, Callable[[int], Scene]] = {"arms": arms, "wall": wall, "back": back, "embrace": embrace}
