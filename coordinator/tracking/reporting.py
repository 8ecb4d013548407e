"""What is reported of a tracked frame: pose, joints, hypotheses, how sure each joint is, a status."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.kinematics import joint_positions
from coordinator.tracking.certainty.assessment import built_in, conclude, recall
from coordinator.tracking.certainty.certainty import Certainty, unknown_certainty
from coordinator.tracking.certainty.evidence import weigh_evidence
from coordinator.tracking.estimate import RECORDED, UNKNOWN, Estimate
from coordinator.tracking.state import TrackerState
from coordinator.tracking.status import explain_doubt, explain_leaps, find_leaps, judge
from coordinator.tracking.step import Updated

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Reported:
    """A frame's estimate, and all that is known after it."""

    estimate: Estimate
    state: TrackerState


def report(tracked: Updated) -> Reported:
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
        leaps = leaps_of(tracked, joints[0])
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
    return Reported(estimate, replace(tracked.state, checkpoint=checkpoint))


def leaps_of(tracked: Updated, joints: Array) -> NDArray[np.bool_]:
    """Which joints (J, 3) of a frame's report are not where they may have gone since the one before."""
    if tracked.sighted is None or tracked.sighted.first:
        return np.zeros(len(joints), dtype=np.bool_)
    past = joint_positions(tracked.state.start.model, tracked.sighted.past[None])[0]
    return find_leaps(joints, past, tracked.sighted.interval)


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
