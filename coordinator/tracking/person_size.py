"""The size of a tracked person: stature in frames with status `tracked`, girth at each new stature.

One camera hardly determines the girth, so it stays as detected, with the detected stature. Cameras on several
sides determine it sharply. At a wrong girth they contradict each other. A live frame does not wait for the
workers that fit it: the body has its old size until they are done.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.tracked import Bodies, Size
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.filters.pose_prior import rest_prior
from gepf.coordinator.tracking.candidate_refinement import ITERATIONS
from gepf.coordinator.tracking.estimate import MAX_HYPOTHESES
from gepf.coordinator.tracking.field_of_view import in_view
from gepf.coordinator.tracking.refiner import Pending, Refiner, iterations
from gepf.coordinator.tracking.reporting import status_of
from gepf.coordinator.tracking.state import Start
from gepf.coordinator.tracking.stature import INTERVAL_S, StatureEstimate, head_to_ankle, measure_stature
from gepf.coordinator.tracking.track_management import TrackManagement

GIRTH_STEPS = np.array([0.85, 1.0, 1.15])  # factors; a parabola through their likelihoods is off by 1 %


class GirthFit(NamedTuple):
    """A fit of the girth under way: the size with the new stature, and a request for each of GIRTH_STEPS."""

    size: Size
    sent: tuple[Pending, ...]

    @property
    def is_ready(self) -> bool:
        """Whether the result would come at once."""
        return all(each.is_ready for each in self.sent)

    def result(self) -> Size:
        """Wait for the size with the likeliest girth."""
        likely = np.array([each.result().log_likelihood[0] for each in self.sent])
        steps = np.linspace(GIRTH_STEPS[0], GIRTH_STEPS[-1], 31)
        visible = np.isfinite(likely).all()
        best = np.polyval(np.polyfit(GIRTH_STEPS, likely, 2), steps).argmax() if visible else len(steps) // 2
        return self.size._replace(girth=float(self.size.girth * steps[best]))

    def cancel(self) -> None:
        """Give up the result."""
        for each in self.sent:
            each.cancel()


class PersonSize:
    """Estimates the size of a person from the detection on, if it is to be measured and is not known."""

    def __init__(
        self, bodies: Bodies, refiner: Refiner, estimate: StatureEstimate | None = None, *, measured: bool
    ) -> None:
        self._bodies, self._refiner = bodies, refiner
        self._measured = measured and bodies.people and not bodies.measures
        self.estimate = estimate  # None if the size is not estimated
        self._fit: GirthFit | None = None

    def begin(
        self, start: Start, belief: Belief, subject: SubjectFrame, rules: RefineSettings, *, wait: bool
    ) -> Start:
        """Begin to estimate: the start with the stature that the first frame shows.

        Without `wait`, the start as it is if the workers have to fit a girth to it first.
        """
        if not (self._measured and start.is_free):
            return start
        self.estimate = StatureEstimate()
        stature = self._shown(start, start.pose, subject) or start.size.stature
        return self._resized(start, stature, belief, subject, rules, wait=wait)

    def revise(
        self,
        start: Start,
        belief: Belief | None,
        subject: SubjectFrame | None,
        rules: RefineSettings,
        *,
        wait: bool,
    ) -> Start:
        """The start with the size that is known by now; `wait` as in `begin`."""
        if self.estimate is None or belief is None:
            return start
        stature = self.estimate.revise(start.size.stature)
        return self._resized(start, stature, belief, subject, rules, wait=wait)

    def end(self) -> None:
        """Give up what is under way."""
        if self._fit is not None:
            self._fit.cancel()
            self._fit = None

    def measure(
        self, start: Start, belief: Belief, management: TrackManagement, subject: SubjectFrame
    ) -> None:
        """Measure the stature in a frame, if one is due and the pose is settled."""
        time_s, poses, weights = subject.frame.time_s, belief.poses[:MAX_HYPOTHESES], belief.weights
        if self.estimate is None or 0.0 <= time_s - self.estimate.time_s < INTERVAL_S:
            return
        joints = joint_positions(start.model, poses)
        joints = joints[:, in_view(subject, joints[0])]
        if status_of(management, weights[:MAX_HYPOTHESES], joints, joints[0], doubted=False) == "tracked":
            stature = self._shown(start, poses[0], subject)
            if stature is not None:
                self.estimate = self.estimate.add(stature, time_s)

    def _resized(
        self,
        start: Start,
        stature: float,
        belief: Belief,
        subject: SubjectFrame | None,
        rules: RefineSettings,
        *,
        wait: bool,
    ) -> Start:
        """The start with another stature, and the likeliest girth if several cameras show the person."""
        if self._fit is None:
            size = start.size._replace(stature=stature)
            if stature == start.size.stature or subject is None or len(subject.views) == 1:
                return start.with_size(size, self._bodies)
            particles = Particles(
                belief.reported[None], iterations(rules, ITERATIONS), velocity=belief.velocity, spare=not wait
            )
            models = [
                self._bodies.tracked(size._replace(girth=girth), start.values)[0]
                for girth in size.girth * GIRTH_STEPS
            ]
            settled = particles.settings
            sent = tuple(
                self._refiner.submit(subject, model, replace(particles, prior=rest_prior(model, settled)))
                for model in models
            )
            self._fit = GirthFit(size, sent)
        if not (wait or self._fit.is_ready):
            return start
        size, self._fit = self._fit.result(), None
        return start.with_size(size, self._bodies)

    def _shown(self, start: Start, pose: Array, subject: SubjectFrame) -> float | None:
        """Stature in metres that a frame shows of the person in pose (D,); None if it does not show it."""
        straight = head_to_ankle(self._bodies.full(*start.size))
        return measure_stature(start.model, pose, straight, subject)
