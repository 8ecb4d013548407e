"""How sure the tracker is of a frame, in one word."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.kinematics.chain import contiguous
from coordinator.tracking.certainty.certainty import OFF, PROBABLE, SUSPECTED, Certainty
from coordinator.tracking.estimate import Status
from coordinator.tracking.track_management import TrackManagement

Array = NDArray[np.float64]

APART = 0.15  # metres, between a joint of one hypothesis and of another
MOST = 0.5  # share of the joints
FASTEST = 12.0  # metres a second, of a joint beside the body's own way: who throws or kicks stays below
RIVAL = 0.5  # weight of a hypothesis, relative to the likeliest, from which on it is a rival


def judge(
    management: TrackManagement, weights: Array, joints: Array, reported: Array, certainty: Certainty
) -> Status:
    """Status of a frame that shows something, from weights (M,) and joints (M, J, 3), likeliest first.

    `reported` (J, 3) are the joints that are reported, which need not be the likeliest's.

    `searching`: the body may be anywhere. `lost`: the reported pose does not explain what is seen, or most
    joints are probably off. `ambiguous`: some joint may be, or a hypothesis about as likely has it elsewhere,
    or front and back look alike.
    """
    if management.seeks:
        return "searching"
    if management.unexplained or np.mean(certainty.off_probability > PROBABLE) > MOST:
        return "lost"
    if management.ambiguous_facing or np.any(certainty.off_probability > SUSPECTED):
        return "ambiguous"
    return "ambiguous" if has_rival(weights, joints, reported) else "tracked"


def is_settled(management: TrackManagement, weights: Array, joints: Array) -> bool:
    """Whether hypotheses explain what is seen, and agree; before anything is said of single joints."""
    return not (
        management.seeks
        or management.unexplained
        or management.ambiguous_facing
        or has_rival(weights, joints, joints[0])
    )


def has_rival(weights: Array, joints: Array, reported: Array) -> bool:
    """Whether the first hypothesis, or one about as likely, has some joint elsewhere than it is reported."""
    return is_apart(weights, contiguous(joints), contiguous(reported))


@numba.njit(cache=True, nogil=True)
def is_apart(weights: Array, joints: Array, reported: Array) -> bool:
    """`has_rival` of arrays in C order."""
    for m in range(len(weights)):
        if weights[m] > RIVAL * weights[0]:
            for j in range(len(reported)):
                x, y = joints[m, j, 0] - reported[j, 0], joints[m, j, 1] - reported[j, 1]
                z = joints[m, j, 2] - reported[j, 2]
                if np.sqrt(x * x + y * y + z * z) > APART:
                    return True
    return False


def explain_doubt(names: tuple[str, ...], certainty: Certainty) -> str:
    """Which of the joints (J,) may be off, in words, the likeliest first; empty where none is."""
    chance = certainty.off_probability
    doubted = [j for j in np.argsort(-chance, kind="stable") if chance[j] > SUSPECTED]
    if not doubted:
        return ""
    listed = ", ".join(names[j].replace("_", " ") for j in doubted)
    return f"may be more than {100 * OFF:.0f} cm off: {listed}"


def find_leaps(joints: Array, past: Array, interval: float) -> NDArray[np.bool_]:
    """Which joints (J,) of (J, 3) went farther since the frame before (J, 3), seconds ago, than people move.

    The way that most of them went is taken off: that of who is found again.
    """
    leaps = np.empty(len(joints), dtype=np.bool_)
    mark_leaps(contiguous(joints - past), FASTEST * interval, leaps)
    return leaps


@numba.njit(cache=True, nogil=True)
def mark_leaps(way: Array, farthest: float, leaps: NDArray[np.bool_]) -> None:
    """Fill leaps (J,): whose way (J, 3) is farther from the median than so many metres."""
    median, half = np.empty(3), len(way) // 2
    for a in range(3):
        ordered = np.sort(way[:, a])
        median[a] = 0.5 * (ordered[half] + ordered[len(way) - 1 - half])
    for j in range(len(way)):
        x, y, z = way[j, 0] - median[0], way[j, 1] - median[1], way[j, 2] - median[2]
        leaps[j] = np.sqrt(x * x + y * y + z * z) > farthest


def explain_leaps(names: tuple[str, ...], leaps: NDArray[np.bool_]) -> str:
    """Which joints (J,) leapt, in words; empty where none did."""
    listed = ", ".join(name.replace("_", " ") for name, leapt in zip(names, leaps, strict=True) if leapt)
    return f"found elsewhere: {listed}" if listed else ""
