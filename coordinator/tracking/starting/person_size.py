"""The size of the tracked person: asked of the frames that can say something, given to the body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings
from coordinator.bodies.tracked import Bodies, name_pose
from coordinator.tracking.starting.asking import Asker, Question
from coordinator.tracking.starting.length import SHOWN, measure_length
from coordinator.tracking.starting.measuring import Measured
from coordinator.tracking.starting.start import USUAL_MEASURES, Start
from coordinator.tracking.starting.uprightness import stance_of

Array = NDArray[np.float64]


class PersonSize:
    """What is known of the size, and the body of that size.

    Args:
        bodies: People of any size.
        measured: What is known already; None where the size is not sought.
    """

    def __init__(self, bodies: Bodies, measured: Measured | None = None) -> None:
        self._asker = Asker(bodies)
        self._bodies = bodies
        self._held: Mapping[str, float] | None = None  # values of who was found last
        self._held_bent = False  # by those that do not move
        self.measured = measured

    def prepare(self) -> None:
        """Make what the first question needs, so that no frame has to wait for it."""
        self._asker.prepare()

    def guess(self, start: Start) -> Start:
        """Seek the size from now on, beginning with that of a start, where the body comes in sizes.

        Gives the start with the same body as one of many sizes.
        """
        if not self._asker.can_ask(start):
            return start
        bent = stance_of(start.model, start.pose).bent
        self.measured = Measured.guessed(start.stature, start.girth, bent=bent)
        return self.resume(start)

    def resume(self, start: Start) -> Start:
        """The start with the same body as one of many sizes, if the size is sought."""
        return start if self.measured is None else self._asker.resize(start, start.stature, start.girth)

    def ask(self, start: Start, pose: Array, time_s: float, rules: RefineSettings) -> Question | None:
        """What to ask a frame in which the body is about in this pose (D,); None if its time has not come."""
        known = self.measured
        if known is None or rules.is_soft or not known.may_ask(time_s):
            return None
        if not known.asks(time_s, bent=stance_of(start.model, pose).bent):
            return None
        return self._asker.ask(start, known, pose, rules)

    def hear(
        self, question: Question, answer: Refined, start: Start, pose: Array, subject: SubjectFrame
    ) -> None:
        """Take in what a frame answered, in which the body turned out to be in this pose (D,)."""
        known, time_s = self.measured, subject.frame.time_s
        assert known is not None
        shown = question.read(start.model, answer)
        if shown is None:
            self.measured = known.passed(time_s)
            return
        stature = None if self._is_held_bent(start) else stature_by_length(start, pose, subject)
        self.measured = known.after(replace(shown, by_length=stature), time_s)

    def give(self, start: Start) -> Start:
        """The start with a body of the size that is known by now, if it is time; the same start otherwise."""
        if self.measured is None or not self.measured.changes(start.stature, start.girth):
            return start
        return self._asker.resize(start, *self.measured.size)

    def _is_held_bent(self, start: Start) -> bool:
        if start.values is not self._held:
            self._held, self._held_bent = start.values, is_held_bent(start, self._bodies)
        return self._held_bent


def is_held_bent(start: Start, bodies: Bodies) -> bool:
    """Whether what does not move is held so that nobody can stand straight: as the legs of who sits."""
    if not start.held:
        return False
    whole = bodies.full(*USUAL_MEASURES)
    return not stance_of(whole, name_pose(whole, start.held)).shows_length


def stature_by_length(start: Start, pose: Array, subject: SubjectFrame) -> float | None:
    """Log stature (m) of who is as long as a frame shows, in a pose (D,); None where it does not.

    Who leans, bends a little or looks down is straightened, by as much as the model is shorter than at rest;
    of who is bent, or looks far down, the length says nothing.
    """
    stance = stance_of(start.model, pose)
    length = measure_length(start.model, pose, subject) if stance.shows_length else None
    return None if length is None else float(np.log(length / (SHOWN * stance.long)))
