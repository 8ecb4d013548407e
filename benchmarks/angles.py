"""Angles of a tracked person against those of the true joints, and how far they step from frame to frame.

python -m benchmarks.angles RUN [TRUTH.npz]
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coordinator.results.completing import read_track_with_angles
from coordinator.results.track import Track
from coordinator.results.truth import read_truth

Array = NDArray[np.float64]


def main(run: str, truth: str | None = None) -> None:
    """Print the largest steps, and with a truth the errors of each angle, degrees."""
    track = read_track_with_angles(Path(run))
    print(f"largest step of the pose {largest(track.pose[:, 3:], turns=True)}, of the angles ", end="")
    print(largest(angles_of(track), turns=False))
    if truth is None:
        return
    true = read_truth(Path(truth))
    known = from_joints(true.joint_names, true.joint_positions[np.isin(true.frame, track.frame)])
    for name, values in known.items():
        off = angles_of(track)[:, (track.angle_names or ()).index(name)] - values
        errors = np.degrees(np.abs((off + np.pi) % (2.0 * np.pi) - np.pi))
        print(
            f"{name:26} mean {errors.mean():5.1f}  median {np.median(errors):5.1f}  worst {errors.max():5.1f}"
        )


def angles_of(track: Track) -> Array:
    """The angles (F, A), radians."""
    if track.angle is None:
        raise SystemExit("this run has no angles and no body to take them from; track it again")
    return track.angle


def largest(values: Array, *, turns: bool) -> str:
    """The largest change between frames, degrees, whole turns aside, and how many are above 60."""
    steps = np.degrees(np.diff(values, axis=0))
    steps = np.abs((steps + 180.0) % 360.0 - 180.0 if turns else steps)
    return f"{steps.max():.1f} ({int((steps > 60.0).sum())} above 60)"


def from_joints(names: tuple[str, ...], joints: Array) -> dict[str, Array]:
    """Elbow, knee, shoulder and hip angles (F,) of joints (F, J, 3); trunk and pelvis share one upright."""

    def at(name: str) -> Array:
        return joints[:, names.index(name)]

    found: dict[str, Array] = {}
    upright = sum(at(f"{s}_shoulder") - at(f"{s}_hip") for s in ("right", "left"))
    for side, out in (("right", -1.0), ("left", 1.0)):
        for hinge, ends in {"elbow": ("shoulder", "wrist"), "knee": ("hip", "ankle")}.items():
            upper = at(f"{side}_{hinge}") - at(f"{side}_{ends[0]}")
            lower = at(f"{side}_{ends[1]}") - at(f"{side}_{hinge}")
            found[f"{side}_{hinge}_flexion"] = np.arccos(np.clip(dot(unit(upper), unit(lower)), -1.0, 1.0))
        for ball, end in {"shoulder": "elbow", "hip": "knee"}.items():
            axes = carrier(np.asarray(upright), at(f"left_{ball}") - at(f"right_{ball}"))
            x, y, z = np.einsum("fij,fi->jf", axes, unit(at(f"{side}_{end}") - at(f"{side}_{ball}")))
            angle = np.arctan2(np.hypot(x, z), y) / np.maximum(np.hypot(x, z), 1e-12)
            found[f"{side}_{ball}_flexion"], found[f"{side}_{ball}_abduction"] = -z * angle, out * x * angle
    return found


def carrier(upright: Array, leftward: Array) -> Array:
    """Axes (F, 3, 3) of trunk or pelvis as columns: left, down, back."""
    down = -unit(upright)
    back = unit(np.cross(leftward, down))
    return np.stack([np.cross(down, back), down, back], axis=-1)


def dot(one: Array, other: Array) -> Array:
    """Products (F,) of vectors (F, 3)."""
    product: Array = np.einsum("fi,fi->f", one, other)
    return product


def unit(vectors: Array) -> Array:
    """Vectors (F, 3) at length 1."""
    scaled: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return scaled


if __name__ == "__main__":
    main(*sys.argv[1:3])
