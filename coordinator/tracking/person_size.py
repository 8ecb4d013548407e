"""The stature of a tracked person, measured in frames in which the pose is settled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.frame import SubjectFrame
from common.kinematics import joint_positions
from coordinator.bodies.tracked import Bodies
from coordinator.filters.belief import Belief
from coordinator.tracking.estimate import MAX_HYPOTHESES
from coordinator.tracking.reporting import is_settled
from coordinator.tracking.size import SizeEstimate, head_to_ankle, measure_stature
from coordinator.tracking.state import Start
from coordinator.tracking.track_management import TrackManagement


class PersonSize:
    """Estimates the stature of a person from the detection on."""

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self.estimate: SizeEstimate | None = None  # None if the size is not estimated

    def begin(self, start: Start, subject: SubjectFrame) -> Start:
        """Begin to estimate: the start with the stature that the first frame shows."""
        self.estimate = SizeEstimate()
        stature = self._shown(start, start.pose, subject) or start.stature
        return start.with_stature(stature, self._bodies)

    def revise(self, start: Start) -> Start:
        """The start with the stature that is known by now."""
        if self.estimate is None:
            return start
        return start.with_stature(self.estimate.revise(start.stature), self._bodies)

    def measure(
        self, start: Start, belief: Belief, management: TrackManagement, subject: SubjectFrame
    ) -> None:
        """Measure the stature in a frame, if one is due and the pose is settled."""
        time_s, poses, weights = subject.frame.time_s, belief.poses[:MAX_HYPOTHESES], belief.weights
        if self.estimate is None or not self.estimate.is_due(time_s):
            return
        if is_settled(management, weights[:MAX_HYPOTHESES], joint_positions(start.model, poses)):
            stature = self._shown(start, poses[0], subject)
            if stature is not None:
                self.estimate = self.estimate.add(stature, time_s)

    def _shown(self, start: Start, pose: NDArray[np.float64], subject: SubjectFrame) -> float | None:
        """Stature in metres that a frame shows of the person in pose (D,); None if it does not show it."""
        straight = head_to_ankle(self._bodies.full(start.stature, start.girth))
        return measure_stature(start.model, pose, straight, subject)
