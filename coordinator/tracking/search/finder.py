"""Finds the body that is tracked: where a run begins, and wherever it is when it is lost or in doubt."""

from __future__ import annotations

from dataclasses import dataclass, replace

from common.frame import SubjectFrame
from common.settings import Settings
from coordinator.filters.belief import Belief
from coordinator.scene.room.planes import Planes
from coordinator.tracking.inference import Inference, Situation
from coordinator.tracking.observing.sensor_noise import SensorNoise, measure_noise
from coordinator.tracking.search.seeker import Finding, Seeker
from coordinator.tracking.search.watch import Watch
from coordinator.tracking.starting.start import Start


@dataclass(frozen=True, slots=True, eq=False)
class Begun:
    """Where tracking begins, what is believed then, and how it went; no belief where nobody was found."""

    start: Start
    belief: Belief | None
    watch: Watch


class Finder:
    """Finds a body, and believes in it.

    Args:
        seeker: Looks for it in single frames.
        inference: Has beliefs of the tracker's kind.
        settings: What to compute.
        given: The body begins where it is said to: it is not looked for at first.
    """

    def __init__(self, seeker: Seeker, inference: Inference, settings: Settings, *, given: bool) -> None:
        self._seeker = seeker
        self._inference = inference
        self._settings = settings
        self._given = given

    def prepare(self) -> None:
        """Make what a first search and the person's size need, where they are looked for."""
        if not self._given:
            self._seeker.prepare()

    def recovers(self, start: Start) -> bool:
        """Whether a body that was found is looked for again."""
        return self._settings.recover and self._seeker.can_find_again(start)

    def begin(self, subject: SubjectFrame, planes: Planes, start: Start, watch: Watch) -> Begun:
        """Begin where the body is given or found, if what is found can be believed."""
        noise = measure_noise(subject.frame) if self._settings.measure_noise else SensorNoise()
        if self._given:
            return Begun(replace(start, noise=noise), self._inference.begin(start.model, start.pose), watch)
        finding, watch = self._seeker.begin(subject, noise, planes, watch)
        if finding is None:
            return Begun(start, None, watch)
        return Begun(finding.start, self._inference.begin_with(finding), watch)

    def find_again(self, subject: SubjectFrame, situation: Situation) -> Finding | None:
        """Where else the body may be, if that is in doubt."""
        start, watch, last = situation.start, situation.watch, situation.belief.reported
        if not (watch.checks and self.recovers(start)):
            return None
        return self._seeker.find_again(subject, start, situation.rules, last, lost=watch.seeks)
