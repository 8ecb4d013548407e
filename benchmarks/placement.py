"""How much of what joints are off is how the reference places them: python -m benchmarks.placement.

The camera's SDK has other joints than an anatomical body: its hips and ankles lie higher, and they move with
the limbs. A linear map from the tracked joints to the reference's, both in the
frame of the trunk, is learned on subjects 1 and 2 and applied to 3 and 4: what is still off then is no matter
of definition. 30 frames a second; lines on stdout. Exit code 1 if a recording crashed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.choices import settings_with
from benchmarks.command_line import add_data, add_processes, measured, one_thread_each
from benchmarks.forks import Crash, run_forked
from benchmarks.frame_rates.reference import read_reference
from benchmarks.frame_rates.trials import joints_of, read_frames
from benchmarks.sequences import Recording, find_people
from benchmarks.tracking import follow, prepare
from benchmarks.utd import JOINTS, distances
from coordinator.bodies.tracked import Bodies
from coordinator.tracking.single import SingleTracker as Tracker
from gepf.direct import DirectRefiner

Array = NDArray[np.float64]
Mapped = Callable[[Array], Array]
"""Joints (F, 13, 3) as tracked -> as the reference has them."""

LEARNED, APPLIED = ("s1", "s2"), ("s3", "s4")
RIDGE = 0.003  # square metres, for each joint that is learned from
NEAR = 0.1  # metres


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Joints (F, 13, 3) of one recording, camera frame, metres, and which of the reference's hold (F, 13)."""

    subject: str
    tracked: Array
    reference: Array
    holds: NDArray[np.bool_]


def main(arguments: Sequence[str] | None = None) -> int:
    """Track, learn, and print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.placement", description=__doc__)
    add_data(parser)
    add_processes(parser)
    chosen = parser.parse_args(arguments)
    one_thread_each()
    return measured("placement", measure, chosen)


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a recording crashed."""
    recordings, bodies = find_people(chosen.data / "utd_mhad"), prepare()
    found: dict[str, Placed] = {}
    crashed = 0
    for recording, result in run_forked(lambda each: place(each, bodies), recordings, chosen.processes):
        if isinstance(result, Crash):
            sys.stderr.write(f"{recording.name}: {result.error}\n")
            crashed += 1
        else:
            found[recording.name] = result
    placed = [found[name] for name in sorted(found)]
    of = {side: [one for one in placed if one.subject in side] for side in (LEARNED, APPLIED)}
    for side, those in of.items():
        for name, mapped in learn(of[LEARNED]).items():
            sys.stdout.write(f"subjects {' '.join(side)}, {name}: {score(those, mapped)}\n")
    return int(crashed > 0)


def place(recording: Recording, bodies: Bodies) -> Placed:
    """Track a recording and put its joints beside the reference's."""
    frames = read_frames(recording)
    tracker = Tracker(DirectRefiner(), settings_with([]), bodies)
    estimates, _ = follow(tracker, frames)
    numbers = np.array([estimate.frame for estimate in estimates])
    there, reference, holds = read_reference(recording.joints, frames).at(numbers)
    tracked = joints_of(estimates, tracker.model.joint_names)[there]
    return Placed(recording.name.rpartition("_")[2], tracked, reference, holds)


def trunk_of(joints: Array) -> Array:
    """Axes (F, 3, 3) to the right, up and to the back of a person's trunk, by joints (F, 13, 3)."""
    left, right, *hips = (
        joints[:, JOINTS.index(name)] for name in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
    )
    up = unit(0.5 * (left + right) - 0.5 * (hips[0] + hips[1]))
    across = right - left
    across = unit(across - up * np.sum(up * across, axis=1, keepdims=True))
    return np.stack([across, up, np.cross(across, up)], axis=1)


def unit(vectors: Array) -> Array:
    """Vectors (F, 3) of length 1."""
    units: Array = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return units


def seen_from_trunk(joints: Array) -> Array:
    """Joints (F, 39) about their mean, in the trunk's frame, and a one, (F, 40)."""
    centred = joints - joints.mean(axis=1, keepdims=True)
    turned = np.einsum("fij,fkj->fki", trunk_of(joints), centred).reshape(len(joints), -1)
    return np.column_stack([turned, np.ones(len(joints))])


def learn(placed: Sequence[Placed]) -> Mapping[str, Mapped]:
    """Ways to the reference's joints: none, a constant offset of each in the trunk's frame, a linear map."""
    seen = np.concatenate([seen_from_trunk(one.tracked) for one in placed])
    apart = np.concatenate(
        [np.einsum("fij,fkj->fki", trunk_of(one.tracked), one.reference - one.tracked) for one in placed]
    )
    constant, mean = np.median(apart, axis=0), np.append(seen[:, :-1].mean(axis=0), 0.0)
    centred = seen - mean
    gram = centred.T @ centred + RIDGE * len(seen) * np.eye(centred.shape[1])
    weights = np.linalg.solve(gram, centred.T @ apart.reshape(len(apart), -1))

    def offset(joints: Array) -> Array:
        moved: Array = joints + np.einsum("fij,ki->fkj", trunk_of(joints), constant)
        return moved

    def linear(joints: Array) -> Array:
        by = ((seen_from_trunk(joints) - mean) @ weights).reshape(joints.shape)
        moved: Array = joints + np.einsum("fij,fki->fkj", trunk_of(joints), by)
        return moved

    return {"as tracked": lambda joints: joints, "constant offsets": offset, "linear map": linear}


def score(placed: Sequence[Placed], mapped: Mapped) -> str:
    """Of joints that hold: per cent near, and the mean distance in cm, offsets removed, and raw."""
    words = []
    for remove_offset in (True, False):
        apart = [distances(mapped(one.tracked), one.reference, remove_offset=remove_offset) for one in placed]
        held = np.concatenate([each[one.holds] for each, one in zip(apart, placed, strict=True)])
        words.append(f"{100.0 * np.mean(held <= NEAR):.1f} % within 10 cm, {100.0 * held.mean():.2f} cm")
    return "{}; raw {}".format(*words)


if __name__ == "__main__":
    sys.exit(main())
