"""The size of the tracked person: asked of the frames that can say something, given to the body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.frame import SubjectFrame
from common.kinematics import joint_positions
from common.settings import RefineSettings
from coordinator.bodies.tracked import Bodies, name_pose
from coordinator.filters.belief import Belief
from coordinator.tracking.estimate import RECORDED
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.search.watch import Watch
from coordinator.tracking.starting.asking import Asker
from coordinator.tracking.starting.length import SHOWN, measure_length
from coordinator.tracking.starting.measuring import Measured, is_bent
from coordinator.tracking.starting.start import USUAL_MEASURES, Start
from coordinator.tracking.status import is_settled


class PersonSize:
    """What is known of the size, and the body of that size.

    Args:
        bodies: People of any size.
        refiner: Has the pose refined for bodies of several sizes.
        measured: What is known already; None where the size is not sought.
    """

    def __init__(self, bodies: Bodies, refiner: Refiner, measured: Measured | None = None) -> None:
        self._asker = Asker(bodies, refiner)
        self._bodies = bodies
        self.measured = measured

    def prepare(self) -> None:
        """Make what the first question needs, so that no frame has to wait for it."""
        self._asker.prepare()

    def guess(self, start: Start) -> None:
        """Seek the size from now on, beginning with that of a start, where the body comes in sizes."""
        if self._asker.can_ask(start):
            self.measured = Measured.guessed(start.stature, start.girth)

    def ask(
        self, start: Start, belief: Belief, watch: Watch, rules: RefineSettings, subject: SubjectFrame
    ) -> None:
        """Ask the frame that was published last, if its pose is settled and its noise is small."""
        time_s = subject.frame.time_s
        if self.measured is None or rules.is_soft:
            return
        if not any(self.measured.asks(time_s, bent=bent) for bent in (False, True)):
            return
        bent = is_bent(start.model, belief.poses[0])
        if not self.measured.asks(time_s, bent=bent):
            return
        poses, weights = belief.poses[:RECORDED], belief.weights[:RECORDED]
        if is_settled(watch, weights, joint_positions(start.model, poses)):
            known = self.measured
            shown = self._asker.ask(start, known, belief.poses[0], rules)
            if shown is None:
                self.measured = known.passed(time_s)
                return
            bent = bent or is_held_bent(start, self._bodies)
            stature = None if bent else stature_by_length(start, belief.poses[0], subject)
            self.measured = known.after(replace(shown, by_length=stature), time_s)

    def give(self, start: Start) -> Start:
        """The start with a body of the size that is known by now, if it is time; the same start otherwise."""
        if self.measured is None or not self.measured.ripe:
            return start
        if self.measured.size == (start.stature, start.girth):
            return start
        return self._asker.resize(start, *self.measured.size)


def is_held_bent(start: Start, bodies: Bodies) -> bool:
    """Whether what does not move is held so that nobody can stand straight: as the legs of who sits."""
    if not start.held:
        return False
    whole = bodies.full(*USUAL_MEASURES)
    return is_bent(whole, name_pose(whole, start.held))


def stature_by_length(start: Start, pose: NDArray[np.float64], subject: SubjectFrame) -> float | None:
    """Log stature (m) of who is as long as a frame shows, standing in a pose (D,); None where it does not."""
    length = measure_length(start.model, pose, subject)
    return None if length is None else float(np.log(length / SHOWN))
