"""Angles of a person from joint positions, often the only ground truth: elbows, knees, shoulders and hips.

They have the names and definitions of `gepf.coordinator.bodies.human.angles`, except that trunk and pelvis
have a common axis here, from the centre of the hips to that of the shoulders.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gepf.common.arrays import Array

Places = Mapping[str, Array]  # (F, 3) of each joint

OUTWARD = {"right": -1.0, "left": 1.0}
HINGES = {"elbow": ("shoulder", "wrist"), "knee": ("hip", "ankle")}
BALLS = {"shoulder": "elbow", "hip": "knee"}
TRUNK = ("right_shoulder", "left_shoulder", "right_hip", "left_hip")


def angles_from_joints(names: tuple[str, ...], joints: Array) -> dict[str, Array]:
    """Angles (F,), radians, as far as the named joints (F, J, 3), in any unit and axes, determine them.

    NaN if a joint is NaN or two coincide.
    """
    at = {name: joints[:, j] for j, name in enumerate(names)}
    return dict([*bends(at), *swings(at)])


def bends(at: Places) -> Iterator[tuple[str, Array]]:
    """Flexion of elbows and knees: 0 if the limb is straight."""
    for side in OUTWARD:
        for hinge, ends in HINGES.items():
            first, middle, last = (f"{side}_{name}" for name in (ends[0], hinge, ends[1]))
            if {first, middle, last} <= set(at):
                upper, lower = unit(at[middle] - at[first]), unit(at[last] - at[middle])
                yield (
                    f"{side}_{hinge}_flexion",
                    np.arccos(np.clip(np.einsum("fi,fi->f", upper, lower), -1.0, 1.0)),
                )


def swings(at: Places) -> Iterator[tuple[str, Array]]:
    """Flexion and abduction of shoulders and hips: components of the swing from hanging along the trunk."""
    if not set(TRUNK) <= set(at):
        return
    upright = sum((at[f"{side}_shoulder"] - at[f"{side}_hip"] for side in OUTWARD), np.zeros(3))
    for side, out in OUTWARD.items():
        for ball, end in BALLS.items():
            if f"{side}_{end}" not in at:
                continue
            axes = carrier(upright, at[f"left_{ball}"] - at[f"right_{ball}"])
            x, y, z = np.einsum("fij,fi->jf", axes, unit(at[f"{side}_{end}"] - at[f"{side}_{ball}"]))
            angle = np.arctan2(np.hypot(x, z), y) / np.maximum(np.hypot(x, z), 1e-12)
            yield f"{side}_{ball}_flexion", -z * angle
            yield f"{side}_{ball}_abduction", out * x * angle


def carrier(upright: Array, leftward: Array) -> Array:
    """Axes (F, 3, 3) of trunk or pelvis as columns: left, down, back."""
    down = -unit(upright)
    back = unit(np.cross(leftward, down))
    return np.stack([np.cross(down, back), down, back], axis=-1)


def unit(vectors: Array) -> Array:
    """Vectors (F, 3) normalised to length 1; NaN if their length is 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0.0, length, np.nan)
