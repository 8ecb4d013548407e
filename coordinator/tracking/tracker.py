"""The tracker: depth frames in, estimates of one person or of several out.

Recorded or live, alone or over workers, it is the same loop: a frame is segmented, particles are predicted
and refined, hypotheses are updated, assessed and reported. While the workers refine one frame, the one before
is reported and the next one is segmented.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame, SubjectFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.scene.scene import NOTHING
from coordinator.scene.scope import Scope
from coordinator.tracking import segmenter
from coordinator.tracking.known_motion import KnownMotion
from coordinator.tracking.loop import Lookahead, Stopwatch
from coordinator.tracking.observation import some_points
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.reporting import Tracked, Updated
from coordinator.tracking.segmenter import Segmented, Segmenter
from coordinator.tracking.state import TrackerState
from coordinator.tracking.target import TargetTracker
from coordinator.tracking.track_management import SEARCH_INTERVAL_FRAMES

Array = NDArray[np.float64]

STEP_M = 0.8  # that a body may go between two frames


class Tracker:
    """Tracks one body, or up to so many people, through a sequence of frames.

    Args:
        refiner: Refines particles, in this process or on workers.
        settings: What to compute, for each person.
        bodies: The bodies that may be tracked.
        people: How many at the most; the first is the one that was detected first.
        scope: Which part of the scene counts, and who is meant.
        start: Values of degrees of freedom in the first frame, metres and radians; None to detect the body.
        motion: Joint motion as encoders report it.
        states: Resume from here: one state a person, of a tracker with the same settings.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        *,
        people: int = 1,
        scope: Scope | None = None,
        start: Mapping[str, float] | None = None,
        motion: KnownMotion | None = None,
        states: Sequence[TrackerState] | None = None,
    ) -> None:
        past: Sequence[TrackerState | None] = states or [None] * people
        self._segmenter = Segmenter(settings.points, scope)
        if states:
            self._segmenter.recall(states[0].checkpoint.scene)
        self._targets = tuple(
            TargetTracker(refiner, settings, bodies, start=start, motion=motion, state=state)
            for state in past
        )
        self._ahead: tuple[DepthFrame, Segmented, list[Stopwatch]] | None = None  # segmented before its turn

    @property
    def people(self) -> int:
        """How many are tracked at the most."""
        return len(self._targets)

    @property
    def states(self) -> list[TrackerState]:
        """All that the next frame goes on from, one a person."""
        return [target.state for target in self._targets]

    def prepare(self) -> None:
        """Load and make what the first frames need, so that no frame waits for it."""
        segmenter.prepare()
        self._targets[0].prepare()

    def track(self, frame: DepthFrame) -> list[Tracked]:
        """Track the next frame."""
        (tracked,) = self.follow([frame], look_ahead=False)
        return tracked

    def follow(self, frames: Iterable[DepthFrame], *, look_ahead: bool = True) -> Iterator[list[Tracked]]:
        """Track frames; what is known of a frame is given out while the workers refine the next one.

        The results are those of `track`. They are given out also where the next frame fails. Without
        `look_ahead`, for live input, a frame is given out before the next one is asked for.
        """
        upcoming, pending = Lookahead(frames), list[Updated]()
        try:
            for frame in upcoming:
                segmented, clocks = self._segment(frame)
                free, updated = list(segmented.candidates), list[Updated]()
                for n, target in enumerate(self._targets):
                    subject = self._assign(n, segmented, free)
                    submitted = target.submit(frame, subject, segmented.view.planes, clocks[n])
                    if pending:
                        tracked, pending = self._report(pending), []
                        yield tracked
                    if n + 1 < self.people:
                        self._targets[n + 1].send_ahead(segmented.subjects[n + 1], clocks[n + 1])
                    elif look_ahead:
                        self._segment_ahead(upcoming.peek())
                    updated.append(target.update(submitted))
                pending = updated
                if not look_ahead:
                    tracked, pending = self._report(pending), []
                    yield tracked
        except (Exception, KeyboardInterrupt):
            if pending:
                yield self._report(pending)
            raise
        if pending:
            yield self._report(pending)

    def _segment(self, frame: DepthFrame) -> tuple[Segmented, list[Stopwatch]]:
        """What a frame shows of each body, and who else is there; now, or as it was done ahead."""
        if self._ahead is None or self._ahead[0] is not frame:
            self._segment_now(frame)
        assert self._ahead is not None
        (_, segmented, clocks), self._ahead = self._ahead, None
        for n, target in enumerate(self._targets):
            target.scene = segmented.change if n == 0 else replace(segmented.change, learned=NOTHING)
        return segmented, clocks

    def _segment_now(self, frame: DepthFrame) -> None:
        clocks = [Stopwatch() for _ in self._targets]
        with clocks[0].stage("segment"):
            segmented = self._segmenter.segment(frame, [target.expected for target in self._targets])
        self._ahead = frame, segmented, clocks

    def _segment_ahead(self, frame: DepthFrame | None) -> None:
        """Segment the frame that comes next, and let the workers have its first person before its turn."""
        if frame is not None:
            self._segment_now(frame)
            assert self._ahead is not None
            _, segmented, clocks = self._ahead
            self._targets[0].send_ahead(segmented.subjects[0], clocks[0])

    def _assign(self, place: int, segmented: Segmented, free: list[SubjectFrame]) -> SubjectFrame | None:
        """The pixels used for a person: those of a free candidate, if the person is undetected or lost.

        People are detected in their order. An assigned candidate is not free any more.
        """
        target, chosen = self._targets[place], segmented.subjects[place]
        if not target.start.found:
            if not all(each.start.found for each in self._targets[:place]) or not free:
                return None
            chosen = free[target.management.searched // SEARCH_INTERVAL_FRAMES % len(free)]
        elif target.expected is None:
            chosen = min(free, key=lambda each: distance(each, target.last_seen), default=None)
        elif target.misses(segmented.pixels(place)):
            chosen = self._find_elsewhere(place, segmented)
        free[:] = [each for each in free if each is not chosen]
        return chosen

    def _find_elsewhere(self, place: int, segmented: Segmented) -> SubjectFrame | None:
        """The present subject, or a nearby candidate with more pixels who is probably the same person."""
        target, pixels = self._targets[place], segmented.pixels(place)
        others = [each.expected for n, each in enumerate(self._targets) if n != place]
        found = self._segmenter.find_candidates(segmented, [each for each in others if each is not None])
        for each in found[:1]:
            near = distance(each, target.last_seen) < STEP_M
            if each.pixels > pixels and (near or pixels < target.least_pixels):
                target.nothing_seen()
                return each
        return segmented.subjects[place]

    def _report(self, updated: Sequence[Updated]) -> list[Tracked]:
        """Assess and report a frame of which all people were updated."""
        reported = [target.report(each) for target, each in zip(self._targets, updated, strict=True)]
        return [Tracked(each.estimate, each.state) for each in reported]


def distance(subject: SubjectFrame, place: Array) -> float:
    """Metres from the middle of what is seen of a person to a place (3,)."""
    return float(np.linalg.norm(np.median(some_points(subject), axis=0) - place))
