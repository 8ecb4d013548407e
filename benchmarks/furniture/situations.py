"""People of many sizes on chairs, boxes, wheelchairs, beds, at desks, and with a child on the lap.

Furniture is placed around the posed body: a seat below the lowest point of buttocks and thighs, its back
behind the trunk. Then arms are drawn until they are clear of the body and of everything else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from benchmarks.furniture.parts import THICK_M, Part, Range, block, deepest, disc, legs, post, rim
from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.errors import GepfError
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.coordinator.bodies.human.measures import LENGTHS, Measures
from gepf.coordinator.bodies.human.template import human_of
from gepf.coordinator.synthesis.scenes import animate

Keys = dict[str, dict[int, float]]
"""Degree of freedom -> frame -> degrees."""
Ranges = Mapping[str, Range]


class Drawing(msgspec.Struct, frozen=True):
    """How people and their motion are drawn."""

    stature_deviation: float = 0.03  #: relative, from that of the list, at most twice
    girth_deviation: float = 0.05  #: the same
    length_deviation: float = 0.03  #: of a length from that implied by the stature, relative
    still: int = 10  #: frames before the first motion
    frames_per_move: Range = (9, 16)
    sway_deg: float = 1.5  #: of the trunk: 1 to 2 cm at the shoulders
    sway_frames: float = 40.0  #: period
    pressed_m: float = 0.006  #: by which a body is pressed into a seat
    deepest_m: float = 0.012  #: that a vertex may be inside of furniture
    tries: int = 400  #: motions of an arm


DRAWING = Drawing()

CHILD_OF_3 = (0.96, 1.0)
SIZES: Mapping[str, tuple[float, float]] = {
    "child of 6": (1.16, 1.0),
    "child of 12": (1.48, 1.0),
    "woman": (1.64, 1.0),
    "man": (1.78, 1.0),
    "tall": (1.94, 0.97),
    "heavy": (1.74, 1.35),
}
"""Stature in metres, and girth."""
ADULTS = ("woman", "man", "tall", "heavy")

SITS: Ranges = {"hip_flexion": (88, 92), "knee_flexion": (86, 94), "hip_abduct": (2, 10)}
ASTRIDE: Ranges = {**SITS, "hip_abduct": (8, 14)}
ON_A_LAP: Ranges = {"hip_flexion": (82, 88), "knee_flexion": (5, 15), "hip_abduct": (2, 8)}
LIES: Ranges = {"hip_flexion": (0, 6), "knee_flexion": (2, 10), "hip_abduct": (3, 12)}
LIES_ASIDE: Ranges = {"hip_flexion": (15, 60), "knee_flexion": (20, 80), "hip_abduct": (0, 3)}

RESTS: Ranges = {
    "shoulder_flexion": (10, 40), "shoulder_abduct": (8, 25), "shoulder_twisting": (-10, 30),
    "elbow_flexion": (30, 80),
}  # fmt: skip
GESTURES: Ranges = {
    "shoulder_flexion": (0, 100), "shoulder_abduct": (8, 55), "shoulder_twisting": (-30, 45),
    "elbow_flexion": (20, 120),
}  # fmt: skip
WRITES: Ranges = {
    "shoulder_flexion": (20, 65), "shoulder_abduct": (8, 40), "shoulder_twisting": (-10, 45),
    "elbow_flexion": (35, 115),
}  # fmt: skip
BESIDE: Ranges = {
    "shoulder_flexion": (-3, 20), "shoulder_abduct": (15, 45), "shoulder_twisting": (-10, 20),
    "elbow_flexion": (5, 40),
}  # fmt: skip
LIES_MOVING: Ranges = {
    "shoulder_flexion": (0, 80), "shoulder_abduct": (12, 60), "shoulder_twisting": (-20, 30),
    "elbow_flexion": (5, 90),
}  # fmt: skip
BEFORE: Ranges = {
    "shoulder_flexion": (40, 90), "shoulder_abduct": (-25, 10), "shoulder_twisting": (-20, 20),
    "elbow_flexion": (10, 100),
}  # fmt: skip
BELOW: Ranges = {
    "shoulder_flexion": (60, 90), "shoulder_abduct": (-25, -10), "shoulder_twisting": (-10, 10),
    "elbow_flexion": (20, 90),
}  # fmt: skip
HOLDS: Ranges = {
    "shoulder_flexion": (10, 50), "shoulder_abduct": (20, 50), "shoulder_twisting": (-10, 45),
    "elbow_flexion": (30, 100),
}  # fmt: skip

ASIDE_BENT_DEG = 6.0  # the trunk of a person who lies on a side, away from the shoulder below

ARM_LINKS = ("clavicle", "upper_arm", "forearm", "hand")
LEG_LINKS = ("thigh", "shank", "foot", "toes", "talus", "heel")


@dataclass(slots=True, eq=False)
class Posed:
    """A person with poses (F, D) in the room, whose surface is known."""

    model: BodyModel
    poses: Array

    @property
    def vertices(self) -> Array:
        """(F, V, 3)."""
        return pose_vertices(self.model, self.poses)

    @property
    def joints(self) -> Array:
        """(F, J, 3)."""
        return joint_positions(self.model, self.poses)

    def at(self, name: str) -> Array:
        """Places (F, 3) of a joint."""
        return np.asarray(self.joints[:, self.model.joint_names.index(name)])

    def surface(self, *links: str) -> Array:
        """Vertices (F, n, 3) of links, of both sides."""
        return np.asarray(self.vertices[:, self.on(*links)])

    def on(self, *links: str) -> Mask:
        """Which vertices (V,) belong to links, of either side."""
        parts = [name.removeprefix("l_").removeprefix("r_") for name in self.model.link_names]
        return np.isin(np.array(parts)[self.model.skin_links[:, 0]], links)

    @property
    def trunk(self) -> Array:
        """Vertices (F, n, 3) of all but limbs."""
        return np.asarray(self.vertices[:, ~self.on(*ARM_LINKS, *LEG_LINKS)])

    def shift(self, **metres: float) -> None:
        """Move the root in all frames."""
        for name, by in metres.items():
            self.poses[:, self.model.dof(f"root_t{name}")] += by


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """A person, furniture, and other people, in the room."""

    person: Posed
    furniture: list[Part]
    others: tuple[Posed, ...] = ()


def draw_measures(stature: float, girth: float, rng: np.random.Generator) -> Measures:
    """A person of about this stature (metres) and girth, with lengths that differ from the usual ones."""
    off = np.clip(rng.standard_normal(2 + len(LENGTHS)), -2.0, 2.0)
    stature *= 1.0 + DRAWING.stature_deviation * off[0]
    girth *= 1.0 + DRAWING.girth_deviation * off[1]
    lengths = np.array(Measures.of(stature, girth).lengths) * (1.0 + DRAWING.length_deviation * off[2:])
    return Measures.of(stature, girth, **dict(zip(LENGTHS, lengths.tolist(), strict=True)))


def draw_from(ranges: Ranges, rng: np.random.Generator) -> dict[str, float]:
    """A value in each range."""
    return {name: float(rng.uniform(*limits)) for name, limits in ranges.items()}


def posed(
    model: BodyModel, legs_deg: Ranges, frames: int, rng: np.random.Generator, lean: Range = (-2, 8)
) -> Posed:
    """A person whose legs are still and whose trunk sways; thighs and shins may differ by side."""
    keys: Keys = {name: {0: v} for s in "lr" for name, v in prefixed(s, draw_from(legs_deg, rng)).items()}
    leans, phase = rng.uniform(*lean), rng.uniform(0.0, 2.0 * np.pi, 2)
    for name, mean, start in (("vl3_tilt", leans, phase[0]), ("vl3_roll", 0.0, phase[1])):
        turn = 2.0 * np.pi * np.arange(0, frames + 5, 5) / DRAWING.sway_frames
        keys[name] = dict(
            zip(
                range(0, frames + 5, 5),
                (mean + DRAWING.sway_deg * np.sin(turn + start)).tolist(),
                strict=True,
            )
        )
    return Posed(model, animate(model, filled(keys, frames))[:frames])


def prefixed(side: str, values: Mapping[str, float]) -> dict[str, float]:
    """Values of one side of the body."""
    return {f"{side}_{name}": value for name, value in values.items()}


def filled(keys: Keys, frames: int) -> Keys:
    """Keys in which constant values have a second key, at the end."""
    return {name: key if len(key) > 1 else {0: key[0], frames: key[0]} for name, key in keys.items()}


def move_arms(
    person: Posed,
    rest: Ranges,
    moves: Ranges,
    rng: np.random.Generator,
    *,
    beside: Sequence[Part],
    others: Sequence[Posed] = (),
    sides: str = "lr",
) -> None:
    """Draw motions of the arms in place that are clear of bodies, and not inside the parts `beside` them.

    GepfError if none is found.
    """
    frames, model = len(person.poses), person.model
    for side in sides:
        word = "left" if side == "l" else "right"
        for _ in range(DRAWING.tries):
            frame, keys = DRAWING.still, [(0, rest_of := draw_from(rest, rng)), (DRAWING.still, rest_of)]
            while frame < frames:
                frame += int(rng.integers(*DRAWING.frames_per_move))
                keys.append((frame, draw_from(moves, rng)))
            of_dof = {name: {n: goal[name] for n, goal in keys} for name in rest}
            drawn = animate(model, {f"{side}_{name}": key for name, key in of_dof.items()})[:frames]
            tried = Posed(model, person.poses.copy())
            for name in rest:
                tried.poses[:, model.dof(f"{side}_{name}")] = drawn[:, model.dof(f"{side}_{name}")]
            if is_clear(tried, word, others) and is_free(tried, side, beside):
                person.poses[:] = tried.poses
                break
        else:
            raise GepfError(f"no motion of the {word} arm is clear of the furniture; choose another seed")


def is_free(person: Posed, side: str, parts: Sequence[Part]) -> bool:
    """Whether an arm is not inside of furniture."""
    owns = np.isin(
        np.array(person.model.link_names)[person.model.skin_links[:, 0]],
        [f"{side}_{link}" for link in ARM_LINKS[1:]],
    )
    return deepest(parts, person.vertices[:, owns]) <= DRAWING.deepest_m


SEGMENTS: Sequence[tuple[str, str, float]] = (
    ("pelvis", "neck", 0.18), ("neck", "head", 0.14),
    ("left_hip", "left_knee", 0.11), ("right_hip", "right_knee", 0.11),
    ("left_knee", "left_ankle", 0.09), ("right_knee", "right_ankle", 0.09),
)  # fmt: skip
"""Ends of body parts, and how far the axis of a forearm is from theirs at least; metres, of an adult."""
ARM_CLEAR_M = 0.08  # the same of the other arm
ADULT_M = 1.75
HAND_SHARE = 0.09  # of stature, from the wrist to where a hand ends


def is_clear(person: Posed, word: str, others: Sequence[Posed]) -> bool:
    """Whether elbow, forearm and hand of one side are outside of the body and of others."""
    elbow, wrist = person.at(f"{word}_elbow"), person.at(f"{word}_wrist")
    reach = (wrist - elbow) / np.linalg.norm(wrist - elbow, axis=1, keepdims=True)
    points = np.stack([elbow, 0.5 * (elbow + wrist), wrist, wrist + HAND_SHARE * tall(person) * reach])
    opposite = "right" if word == "left" else "left"
    arm = ((f"{opposite}_elbow", f"{opposite}_wrist", ARM_CLEAR_M),) if word == "right" else ()
    arms = tuple((f"{s}_elbow", f"{s}_wrist", ARM_CLEAR_M) for s in ("left", "right"))
    for body, segments in ((person, (*SEGMENTS, *arm)), *((one, (*SEGMENTS, *arms)) for one in others)):
        scale = tall(body) / ADULT_M * stout(body)
        for a, b, clear in segments:
            if np.any(distance_to(points, body.at(a), body.at(b)) < clear * scale):
                return False
    return True


def tall(person: Posed) -> float:
    """The stature, metres, of the surface at rest."""
    return float(np.ptp(person.model.vertices[:, 1]))


def stout(person: Posed) -> float:
    """How much deeper the trunk is than an adult's of the same stature, at least 1."""
    rest = person.model.vertices[person.on("vl1", "vl3", "vl5", "vt8")]
    return max(1.0, float(np.ptp(rest[:, 2])) / tall(person) / 0.14)


def distance_to(points: Array, a: Array, b: Array) -> Array:
    """Distances (n, F) of points (n, F, 3) from the segments from a to b (F, 3)."""
    axis = b - a
    share = np.clip(np.sum((points - a) * axis, axis=-1) / np.sum(axis * axis, axis=-1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - share[..., None] * axis, axis=-1))


def seat_down(person: Posed, seat: float | None) -> float:
    """Lift the person onto a seat of this height, or so that the feet are on the floor; returns the height.

    The seat is never so high that feet do not hang, and never so low that legs are in the floor.
    """
    thighs = person.surface("pelvis", "thigh")
    needed = float(person.vertices[..., 1].max() - thighs[..., 1].max()) + DRAWING.pressed_m
    height = needed if seat is None else max(seat, needed)
    person.shift(y=-height - float(thighs[..., 1].max()) + DRAWING.pressed_m)
    return height


def seat_of(person: Posed) -> tuple[Range, Range]:
    """Sides and ends of a seat: x, and z from the back of the knees to behind the buttocks."""
    hips = person.surface("pelvis", "thigh")
    wide = 0.5 * float(np.ptp(hips[..., 0]))
    rear = float(person.trunk[..., 2].max()) + 0.005
    calves = float(person.surface("shank")[..., 2].max()) + 0.01
    half = max(0.19, 0.85 * wide)
    return (-half, half), (calves, rear)


def back_of(x: Range, rear: float, seat: float, rng: np.random.Generator) -> Iterator[Part]:
    """The back of a chair behind the trunk: a board, or posts with slats."""
    top = seat + rng.uniform(0.35, 0.55)
    if rng.random() < 0.5:
        yield block(x, (rear, rear + 0.03), (seat + rng.choice([0.0, 0.12]), top))
    else:
        half = 0.5 * THICK_M
        for side in (x[0] + half, x[1] - half):
            yield post(side, rear + half, (seat, top))
        for high in np.linspace(seat + 0.15, top - 0.06, int(rng.integers(2, 4))):
            yield block(x, (rear, rear + 0.02), (high, high + 0.06))


def chair_for(person: Posed, seat: float, rng: np.random.Generator) -> list[Part]:
    """A chair with four legs, a seat and a back."""
    x, z = seat_of(person)
    behind = (z[0], z[1] + THICK_M)
    return [block(x, behind, (seat - 0.04, seat)), *legs(x, behind, seat), *back_of(x, z[1], seat, rng)]


def box_for(person: Posed, seat: float, rng: np.random.Generator) -> list[Part]:
    """A box without a back."""
    x, z = seat_of(person)
    return [block(x, (z[0], z[1] + rng.uniform(0.0, 0.1)), (0.0, seat))]


def usual_seat(rng: np.random.Generator) -> float:
    """Height of a seat for adults, on which the feet of children hang."""
    return float(rng.uniform(0.40, 0.46))


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
    """Sits in a wheelchair: seat, back, arm rests, two large wheels, two small ones, foot plates."""
    person = posed(model, SITS, frames, rng)
    seat = seat_down(person, rng.uniform(0.46, 0.52))
    (left, right), (front, rear) = seat_of(person)
    hips = person.surface("pelvis", "thigh")[..., 0]
    left, right = min(left, float(hips.min()) - 0.01), max(right, float(hips.max()) + 0.01)
    made = [
        block((left, right), (front, rear), (seat - 0.03, seat)),
        block((left, right), (rear, rear + 0.03), (seat, seat + rng.uniform(0.38, 0.5))),
    ]
    arms, radius, wide = seat + rng.uniform(0.16, 0.22), rng.uniform(0.27, 0.31), 0.025
    axle, spoked = rear - rng.uniform(0.02, 0.12), rng.random() < 0.5
    for edge, out in ((left, -1.0), (right, 1.0)):
        side = between(edge, edge + 0.04 * out)
        made.append(block(side, (front + 0.05, rear), (arms - 0.03, arms)))
        made.append(
            block(between(edge, edge + 0.015 * out), (front + 0.12, rear), (seat - 0.03, arms - 0.02))
        )
        made.append(post(edge + 0.02 * out, front + 0.07, (seat - 0.03, arms - 0.02)))
        wheel = between(edge + 0.05 * out, edge + (0.05 + wide) * out)
        made += rim(wheel, axle, radius, radius) if spoked else [disc(wheel, axle, radius, radius)]
        small = between(edge - 0.03 * out, edge)
        made.append(disc(small, front - 0.02, 0.08, 0.08))
        made.append(post(edge - 0.0175 * out, front - 0.02, (0.12, seat - 0.03)))
    feet = person.surface("foot", "toes")
    lowest = -float(person.vertices[..., 1].max())
    x, z = (
        (float(feet[..., 0].min()), float(feet[..., 0].max())),
        (float(feet[..., 2].min()), float(feet[..., 2].max())),
    )
    plate = (max(0.0, lowest - 0.02), lowest + DRAWING.pressed_m)
    made.append(block((x[0] - 0.01, -0.01), z, plate))
    made.append(block((0.01, x[1] + 0.01), z, plate))
    move_arms(person, RESTS, GESTURES, rng, beside=made)
    return Situation(person, made)


def between(a: float, b: float) -> Range:
    """The range of two ends in any order."""
    return min(a, b), max(a, b)


def desk(model: BodyModel, frames: int, rng: np.random.Generator) -> Situation:
    """Sits behind a desk on a chair or a box; the forearms move above the board."""
    person = posed(model, SITS, frames, rng, lean=(0, 12))
    seat = seat_down(person, usual_seat(rng))
    made = (chair_for if rng.random() < 0.7 else box_for)(person, seat, rng)
    thighs = -float(person.surface("thigh")[..., 1].min())
    elbows = -float(hanging(person)[..., 1].mean())
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


def hanging(person: Posed) -> Array:
    """Places of the elbows (2, F, 3) if the arms hang."""
    return np.stack([person.at("left_elbow"), person.at("right_elbow")])


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


def mean_of(ranges: Ranges) -> dict[str, float]:
    """The middle of each range."""
    return {name: 0.5 * (low + high) for name, (low, high) in ranges.items()}


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
