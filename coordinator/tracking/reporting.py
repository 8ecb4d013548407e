"""What is reported of a frame: pose, joints, hypotheses, how sure each joint is, and a status in one word."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.frame import DepthFrame
from common.kinematics import joint_positions
from common.kinematics.chain import contiguous
from coordinator.filters.belief import Belief
from coordinator.tracking.certainty.assessment import built_in, conclude, recall
from coordinator.tracking.certainty.certainty import OFF, PROBABLE, SUSPECTED, Certainty, unknown_certainty
from coordinator.tracking.certainty.evidence import Sighted, weigh_evidence
from coordinator.tracking.estimate import RECORDED, UNKNOWN, Estimate, Status
from coordinator.tracking.loop import Stopwatch
from coordinator.tracking.state import TrackerState
from coordinator.tracking.track_management import TrackManagement

Array = NDArray[np.float64]

APART_M = 0.15  # between a joint of one hypothesis and of another
MOST_JOINTS = 0.5  # share of the joints
FASTEST_M_S = 12.0  # of a joint beside the body's own way: who throws or kicks stays below
RIVAL_WEIGHT = 0.5  # of a hypothesis, relative to the likeliest, from which on it is a rival


@dataclass(frozen=True, slots=True, eq=False)
class Updated:
    """A frame whose belief is updated, and which is not reported yet."""

    frame: DepthFrame
    state: TrackerState  # after it
    belief: Belief | None  # the same as in the state
    status: Status | None  # None: judge by the belief
    answered: int  # particles
    sighted: Sighted | None  # None where nothing of the body was seen
    clock: Stopwatch


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """One person in one frame: what is reported, and all that is known after it."""

    estimate: Estimate
    state: TrackerState


def report(tracked: Updated) -> Tracked:
    """What was found in a frame that was collected, when the one before it had been reported."""
    with tracked.clock.stage("report"):
        management, model = tracked.state.checkpoint.management, tracked.state.start.model
        names = model.joint_names
        belief = tracked.belief
        reported = tracked.state.start.pose if belief is None else belief.reported
        weights = np.empty(0) if belief is None else belief.weights[:RECORDED]
        shown = reported[None][:0] if belief is None else belief.poses[:RECORDED]
        joints = joint_positions(model, np.concatenate([reported[None], shown]))
        certainty, verdict = assess(tracked, reported, shown, weights)
        leaps = np.zeros(len(names), dtype=np.bool_)
        if tracked.sighted is not None and not tracked.sighted.first:
            past = joint_positions(model, tracked.sighted.past[None])[0]
            leaps = find_leaps(joints[0], past, tracked.sighted.interval)
        status = tracked.status or judge(management, weights, joints[1:], joints[0], certainty)
        if status == "tracked" and leaps.any():
            status = "ambiguous"
    estimate = Estimate(
        frame=tracked.frame.number,
        time_s=tracked.frame.time_s,
        status=status,
        pose=reported,
        joint_positions=joints[0],
        hypothesis_pose=shown,
        hypothesis_weight=weights / weights.sum() if len(weights) else weights,
        residual=np.nan if belief is None else float(belief.residual[0]),
        particles_answered=tracked.answered,
        why=management.reason or explain_doubt(names, certainty) or explain_leaps(names, leaps),
        stage_seconds=tracked.clock.seconds,
        certainty=unknown_certainty(len(model.joint_names)) if status in UNKNOWN else certainty,
    )
    checkpoint = replace(tracked.state.checkpoint, verdict=verdict)
    return Tracked(estimate, replace(tracked.state, checkpoint=checkpoint))


def assess(
    tracked: Updated, pose: Array, hypotheses: Array, weights: Array
) -> tuple[Certainty, Array | None]:
    """How sure each joint of a reported pose is, by what the frame shows and by what was known before.

    Also returns the verdict (J, 2) from which the next frame goes on; None where nothing is seen.
    """
    model = tracked.state.start.model
    if tracked.sighted is None:
        return unknown_certainty(len(model.joint_names)), None
    evidence = weigh_evidence(model, pose, hypotheses, weights, tracked.sighted)
    before = tracked.state.checkpoint.verdict
    now = built_in().judge(evidence, lone=tracked.sighted.lone)
    verdict = recall(now, before, tracked.sighted.interval)
    return conclude(evidence, verdict), verdict


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
    if management.unexplained or np.mean(certainty.off_probability > PROBABLE) > MOST_JOINTS:
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
        if weights[m] > RIVAL_WEIGHT * weights[0]:
            for j in range(len(reported)):
                x, y = joints[m, j, 0] - reported[j, 0], joints[m, j, 1] - reported[j, 1]
                z = joints[m, j, 2] - reported[j, 2]
                if np.sqrt(x * x + y * y + z * z) > APART_M:
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
    mark_leaps(contiguous(joints - past), FASTEST_M_S * interval, leaps)
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
