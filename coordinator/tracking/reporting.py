"""What is reported of a tracked frame: pose, joints, hypotheses, how sure each joint is, a status."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.kinematics import joint_positions
from coordinator.tracking.certainty.assessment import conclude, judge_evidence, recall
from coordinator.tracking.certainty.certainty import Certainty, unknown_certainty
from coordinator.tracking.certainty.evidence import weigh_evidence
from coordinator.tracking.estimate import RECORDED, UNKNOWN, Estimate
from coordinator.tracking.state import TrackerState
from coordinator.tracking.status import explain_doubt, judge
from coordinator.tracking.step import Tracked

Array = NDArray[np.float64]


class Reporter:
    """Reports frames in their order: what is known of a joint fades over the frames after.

    Args:
        verdict: About each joint, (J, 2), of the frame that was reported last; None before the first.
    """

    def __init__(self, verdict: Array | None = None) -> None:
        self.verdict = verdict

    def report(self, tracked: Tracked) -> Estimate:
        """What was found in a frame that was collected."""
        with tracked.clock.stage("report"):
            watch, model = tracked.state.checkpoint.watch, tracked.state.start.model
            belief = tracked.belief
            reported = tracked.state.start.pose if belief is None else belief.reported
            weights = np.empty(0) if belief is None else belief.weights[:RECORDED]
            shown = reported[None][:0] if belief is None else belief.poses[:RECORDED]
            joints = joint_positions(model, np.concatenate([reported[None], shown]))
            certainty = self._assess(tracked, reported, shown, weights)
            status = tracked.status or judge(watch, weights, joints[1:], certainty)
        return Estimate(
            frame=tracked.frame.number,
            time_s=tracked.frame.time_s,
            status=status,
            pose=reported,
            joint_positions=joints[0],
            hypothesis_pose=shown,
            hypothesis_weight=weights / weights.sum() if len(weights) else weights,
            residual=np.nan if belief is None else float(belief.residual[0]),
            particles_answered=tracked.answered,
            why=watch.why or explain_doubt(model.joint_names, certainty),
            stage_seconds=tracked.clock.seconds,
            certainty=unknown_certainty(len(model.joint_names)) if status in UNKNOWN else certainty,
        )

    def state_after(self, tracked: Tracked) -> TrackerState:
        """All that is known after a frame, once it is reported."""
        checkpoint = replace(tracked.state.checkpoint, verdict=self.verdict)
        return replace(tracked.state, checkpoint=checkpoint)

    def _assess(self, tracked: Tracked, pose: Array, hypotheses: Array, weights: Array) -> Certainty:
        """How sure each joint of a reported pose is, by what the frame shows."""
        model = tracked.state.start.model
        if tracked.sighted is None:
            self.verdict = None
            return unknown_certainty(len(model.joint_names))
        evidence = weigh_evidence(model, pose, hypotheses, weights, tracked.sighted)
        self.verdict = recall(judge_evidence(evidence), self.verdict, tracked.sighted.interval)
        return conclude(evidence, self.verdict)
