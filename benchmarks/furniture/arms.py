"""Motions of arms that are clear of the body, of other people and of furniture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.furniture.parts import Part, deepest
from benchmarks.furniture.people import ARM_LINKS, DRAWING, Posed, Ranges, draw_from, stout, tall
from gepf.common.arrays import Array
from gepf.common.errors import GepfError
from gepf.coordinator.synthesis.scenes import animate

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


def distance_to(points: Array, a: Array, b: Array) -> Array:
    """Distances (n, F) of points (n, F, 3) from the segments from a to b (F, 3)."""
    axis = b - a
    share = np.clip(np.sum((points - a) * axis, axis=-1) / np.sum(axis * axis, axis=-1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - a - share[..., None] * axis, axis=-1))
