"""People on chairs, boxes, wheelchairs, beds, at desks, and with a child on the lap.

Furniture is placed around the posed body: a seat below the lowest point of buttocks and thighs, its back
behind the trunk. Then arms are drawn until they are clear of the body and of everything else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.furniture.arms import (
    BEFORE,
    BELOW,
    BESIDE,
    GESTURES,
    HOLDS,
    LIES_MOVING,
    RESTS,
    WRITES,
    move_arms,
)
from benchmarks.furniture.parts import Part, block, legs
from benchmarks.furniture.people import (
    ADULTS,
    ARM_LINKS,
    CHILD_OF_3,
    DRAWING,
    SIZES,
    Posed,
    Ranges,
    draw_measures,
    mean_of,
    posed,
)
from benchmarks.furniture.seats import box_for, chair_for, seat_down, usual_seat, wheelchair_for
from gepf.common.body import BodyModel
from gepf.coordinator.bodies.human.template import human_of

SITS: Ranges = {"hip_flexion": (88, 92), "knee_flexion": (86, 94), "hip_abduct": (2, 10)}
ASTRIDE: Ranges = {**SITS, "hip_abduct": (8, 14)}
ON_A_LAP: Ranges = {"hip_flexion": (82, 88), "knee_flexion": (5, 15), "hip_abduct": (2, 8)}
LIES: Ranges = {"hip_flexion": (0, 6), "knee_flexion": (2, 10), "hip_abduct": (3, 12)}
LIES_ASIDE: Ranges = {"hip_flexion": (15, 60), "knee_flexion": (20, 80), "hip_abduct": (0, 3)}

ASIDE_BENT_DEG = 6.0  # the trunk of a person who lies on a side, away from the shoulder below


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """A person, furniture, and other people, in the room."""

    person: Posed
    furniture: list[Part]
    others: tuple[Posed, ...] = ()


def chair(model: BodyModel, frames: int, rng: np.random.Generator) -> Situation:
    """Sits on a chair with a back."""
    person = posed(model, SITS, frames, rng)
    made = chair_for(person, seat_down(person, usual_seat(rng)), rng)
    move_arms(person, RESTS, GESTURES, rng, beside=made)
    return Situation(person, made)


def box(model: BodyModel, frames: int, rng: np.random.Generator) -> Situation:
    """Sits on a box without a back."""
    person = posed(model, SITS, frames, rng, lean=(-2, 20))
    made = box_for(person, seat_down(person, None), rng)
    move_arms(person, RESTS, GESTURES, rng, beside=made)
    return Situation(person, made)


def wheelchair(model: BodyModel, frames: int, rng: np.random.Generator) -> Situation:
    """Sits in a wheelchair."""
    person = posed(model, SITS, frames, rng)
    made = wheelchair_for(person, seat_down(person, rng.uniform(0.46, 0.52)), rng)
    move_arms(person, RESTS, GESTURES, rng, beside=made)
    return Situation(person, made)


def desk(model: BodyModel, frames: int, rng: np.random.Generator) -> Situation:
    """Sits behind a desk on a chair or a box; the forearms move above the board."""
    person = posed(model, SITS, frames, rng, lean=(0, 12))
    seat = seat_down(person, usual_seat(rng))
    made = (chair_for if rng.random() < 0.7 else box_for)(person, seat, rng)
    thighs = -float(person.surface("thigh")[..., 1].min())
    hanging = np.stack([person.at("left_elbow"), person.at("right_elbow")])  # arms are not moved yet
    elbows = -float(hanging[..., 1].mean())
    top = max(thighs + 0.04, elbows - 0.03 + rng.uniform(-0.02, 0.02))
    near = float(person.trunk[..., 2].min()) - rng.uniform(0.02, 0.08)
    far, half = near - rng.uniform(0.6, 0.8), rng.uniform(0.6, 0.8)
    board, below = (
        block((-half, half), (far, near), (top - 0.03, top)),
        block((-half, half), (far, near), (0.0, top)),
    )
    made += [board, *legs((-half, half), (far, near), top - 0.01)]
    if rng.random() < 0.5:
        made.append(block((-half, half), (far + 0.03, far + 0.05), (0.25, top - 0.02)))
    move_arms(person, WRITES, WRITES, rng, beside=[*made, below])
    return Situation(person, made)


def bed(model: BodyModel, frames: int, rng: np.random.Generator) -> Situation:
    """Lies on a bed without a blanket, on the back or on a side."""
    aside = int(rng.integers(3)) - 1  # on the left side, the back, the right side
    person = posed(model, LIES_ASIDE if aside else LIES, frames, rng, lean=(0, 10) if aside else (0, 0))
    poses, down, up = person.poses, "r" if aside > 0 else "l", "l" if aside > 0 else "r"
    poses[:, model.dof("root_rx")] = -0.5 * np.pi
    poses[:, model.dof("root_ry")] = 0.5 * np.pi * aside + np.radians(rng.uniform(-8.0, 8.0))
    if aside:
        for name, angle in mean_of(BELOW).items():
            poses[:, model.dof(f"{down}_{name}")] = np.radians(angle)
        for name in LIES_ASIDE:
            poses[:, model.dof(f"{up}_{name}")] = poses[:, model.dof(f"{down}_{name}")]
        poses[:, model.dof("vl3_roll")] = np.radians(-ASIDE_BENT_DEG * aside)
    else:
        poses[:, [model.dof("vl3_tilt"), model.dof("vl3_roll")]] = 0.0
    bends = rng.uniform(5.0, 15.0) if aside else rng.uniform(10.0, 40.0)
    draw_up(person, up, bends)
    height = rng.uniform(0.45, 0.55)
    lies = person.vertices[:, ~person.on("forearm", "hand", *(() if aside else ARM_LINKS))]
    person.shift(y=-height - float(lies[..., 1].max()) + DRAWING.pressed_m)
    head = float(lies[..., 2].max()) + rng.uniform(0.05, 0.2)
    middle, half = float(lies[..., 0].mean()), rng.uniform(0.45, 0.6)
    x, z = (middle - half, middle + half), (min(head - 2.0, float(lies[..., 2].min()) - 0.05), head)
    made = [block(x, z, (0.0, height))]
    if rng.random() < 0.5:
        made.append(block(x, (head, head + 0.04), (0.0, height + rng.uniform(0.2, 0.4))))
    if aside:
        move_arms(person, BELOW, BELOW, rng, beside=made, sides=down)
        move_arms(person, BEFORE, BEFORE, rng, beside=made, sides=up)
    else:
        move_arms(person, BESIDE, LIES_MOVING, rng, beside=made)
    return Situation(person, made)


def draw_up(person: Posed, side: str, bend_deg: float) -> None:
    """Bend one leg in place, so that the foot stays near where it lies."""
    frames, model = len(person.poses), person.model
    share = np.clip((np.arange(frames) - DRAWING.still) / (0.6 * frames), 0.0, 1.0)
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    person.poses[:, model.dof(f"{side}_hip_flexion")] += np.radians(bend_deg) * share
    person.poses[:, model.dof(f"{side}_knee_flexion")] += np.radians(1.7 * bend_deg) * share


def lap(model: BodyModel, frames: int, rng: np.random.Generator) -> Situation:
    """Sits on a chair with a child of three years on the lap."""
    person = posed(model, ASTRIDE, frames, rng, lean=(-2, 2))
    made = chair_for(person, seat_down(person, usual_seat(rng)), rng)
    child = posed(human_of(draw_measures(*CHILD_OF_3, rng)), ON_A_LAP, frames, rng, lean=(0, 5))
    child.shift(z=float(person.trunk[..., 2].min() - child.trunk[..., 2].max()) - 0.01)
    below, on = child.surface("pelvis", "thigh"), person.surface("thigh")
    beneath = (on[..., 2] > below[..., 2].min()) & (on[..., 2] < below[..., 2].max())
    child.shift(y=float(on[beneath][:, 1].min() - below[..., 1].max()) + DRAWING.pressed_m)
    for side in "lr":
        for dof, angle in mean_of(RESTS).items():
            child.poses[:, child.model.dof(f"{side}_{dof}")] = np.radians(angle)
    move_arms(person, HOLDS, HOLDS, rng, beside=made, others=[child])
    return Situation(person, made, (child,))


SITUATIONS: Mapping[str, Callable[[BodyModel, int, np.random.Generator], Situation]] = {
    "chair": chair,
    "box": box,
    "wheelchair": wheelchair,
    "desk": desk,
    "bed": bed,
    "lap": lap,
}


def size_of(name: str, nth: int) -> str:
    """The size of the n-th person in a situation: all in turn; only adults have a child on their lap."""
    sizes = ADULTS if name == "lap" else tuple(SIZES)
    return sizes[nth % len(sizes)]
