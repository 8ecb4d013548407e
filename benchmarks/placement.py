"""The part of the error that comes from the reference's joint positions: python -m benchmarks.placement.

The vendor's joints are not anatomical: hips and ankles are higher, and they move with the limbs. A linear map
from the tracked joints to the reference's, both in the trunk's coordinates, is fitted on subjects 1 and 2 and
applied to 3 and 4. The remaining error does not come from the definition of the joints.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.people import DEFAULT, Trial, pool, run_trials
from benchmarks.recordings import JOINTS, find_people
from benchmarks.running import add_data, add_processes, command_line, keep, measured
from benchmarks.tracking import Outcome, near_percent
from gepf.common.arrays import Array

Mapped = Callable[[Array], Array]
"""Joints (F, 13, 3) as tracked -> as the reference has them."""

LEARNED, APPLIED = (1, 2), (3, 4)  # subjects
RIDGE_M2 = 0.003  # for each joint of the fit


def main(arguments: Sequence[str] | None = None) -> int:
    """Track, fit, and print the table."""
    parser = command_line("placement", __doc__)
    add_data(parser)
    add_processes(parser)
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a recording crashed."""
    trials = [Trial(DEFAULT, 1, 0, recording) for recording in find_people(chosen.data)]
    outcomes = list(run_trials(trials, chosen.processes).values())
    sides = [[one for one in outcomes if one.recording.subject in side] for side in (LEARNED, APPLIED)]
    lines = [
        f"subjects {side[0]} {side[1]}, {name}: {score(those, mapped)}"
        for side, those in zip((LEARNED, APPLIED), sides, strict=True)
        for name, mapped in learn(sides[0]).items()
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    keep(lines, chosen.out)
    return int(len(outcomes) < len(trials))


def trunk_of(joints: Array) -> Array:
    """Axes (F, 3, 3) of a person's trunk (right, up, back), from joints (F, 13, 3)."""
    left, right, *hips = (
        joints[:, JOINTS.index(name)] for name in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
    )
    up = unit(0.5 * (left + right) - 0.5 * (hips[0] + hips[1]))
    across = right - left
    across = unit(across - up * np.sum(up * across, axis=1, keepdims=True))
    return np.stack([across, up, np.cross(across, up)], axis=1)


def unit(vectors: Array) -> Array:
    """Vectors (F, 3), normalised."""
    units: Array = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return units


def in_trunk(vectors: Array, joints: Array) -> Array:
    """Vectors (F, 13, 3) in the coordinates of the joints' trunk."""
    turned: Array = np.einsum("fij,fkj->fki", trunk_of(joints), vectors)
    return turned


def features(joints: Array) -> Array:
    """Joints (F, 39) relative to their mean, in the trunk's coordinates."""
    centred = joints - joints.mean(axis=1, keepdims=True)
    return in_trunk(centred, joints).reshape(len(joints), -1)


def learn(outcomes: Sequence[Outcome]) -> Mapping[str, Mapped]:
    """Maps to the reference's joints: none, constant offsets in the trunk's coordinates, a linear map."""
    seen = np.concatenate([features(one.joints) for one in outcomes])
    apart = np.concatenate([in_trunk(one.reference - one.joints, one.joints) for one in outcomes])
    constant, mean = np.median(apart, axis=0), seen.mean(axis=0)
    centred = np.column_stack([seen - mean, np.ones(len(seen))])
    gram = centred.T @ centred + RIDGE_M2 * len(seen) * np.eye(centred.shape[1])
    weights = np.linalg.solve(gram, centred.T @ apart.reshape(len(apart), -1))

    def moved(joints: Array, by: Array) -> Array:
        out: Array = joints + np.einsum("fij,fki->fkj", trunk_of(joints), np.broadcast_to(by, joints.shape))
        return out

    def linear(joints: Array) -> Array:
        by = (features(joints) - mean) @ weights[:-1] + weights[-1]
        return moved(joints, by.reshape(joints.shape))

    return {
        "as tracked": lambda joints: joints,
        "constant offsets": lambda joints: moved(joints, constant),
        "linear map": linear,
    }


def score(outcomes: Sequence[Outcome], mapped: Mapped) -> str:
    """For joints with a valid reference: percentage near and mean distance, with offsets removed, and raw."""
    placed = [replace(one, joints=mapped(one.joints)) for one in outcomes]
    held = [pool(placed, raw=raw, held=True) for raw in (False, True)]
    words = [f"{near_percent(one):.1f} % within 10 cm, {100.0 * one.mean():.2f} cm" for one in held]
    return "{}; raw {}".format(*words)


if __name__ == "__main__":
    sys.exit(main())
