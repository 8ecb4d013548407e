"""The tracker: depth frames in, estimates of one or more people out.

All input goes through one loop, `Tracker.follow`: segment a frame, predict particles, refine them, update the
hypotheses, report. While the workers refine one frame, the frame before is reported and the next one is
segmented.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame, SubjectFrame
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.scene.scene import NOTHING, SETTLED_FRAMES
from coordinator.scene.scope import Scope
from coordinator.stopwatch import Stopwatch
from coordinator.tracking import segmenter
from coordinator.tracking.known_motion import KnownMotion
from coordinator.tracking.loop import Live, Lookahead, Pace
from coordinator.tracking.observation import middle_of
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.reporting import Tracked, Updated, report
from coordinator.tracking.segmenter import Segmented, Segmenter
from coordinator.tracking.state import TrackerState
from coordinator.tracking.target import TargetTracker
from coordinator.tracking.track_management import SEARCH_INTERVAL_FRAMES

Array = NDArray[np.float64]

STEP_M = 0.8  # largest motion of a body between two frames


class Tracker:
    """Tracks one body, or several people, through a sequence of frames.

    Args:
        refiner: Refines particles, in this process or on workers.
        settings: What to compute, for each person.
        bodies: The bodies that may be tracked.
        people: Largest number of people; they are numbered in the order of their detection.
        scope: Which part of the scene counts, and which person is meant.
        start: Values of degrees of freedom in the first frame, metres and radians; None to detect the body.
        motion: Joint motion as encoders report it.
        states: States to resume from, one per person, of a tracker with the same settings.
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

    @property
    def people(self) -> int:
        """Largest number of people that are tracked."""
        return len(self._targets)

    @property
    def _any_is_tracked(self) -> bool:
        return any(target.is_tracked for target in self._targets)

    @property
    def states(self) -> list[TrackerState]:
        """Everything that the next frame depends on, one state per person."""
        return [target.state for target in self._targets]

    def prepare(self) -> None:
        """Load and build in advance what the first frames need."""
        segmenter.prepare()
        self._targets[0].prepare()

    def track(self, frame: DepthFrame) -> list[Tracked]:
        """Track the next frame."""
        (tracked,) = self.follow([frame], look_ahead=False)
        return tracked

    def follow(
        self, frames: Iterable[DepthFrame], *, look_ahead: bool = True, live: Live | None = None
    ) -> Iterator[list[Tracked]]:
        """Track frames; each frame is reported while the workers refine the next one.

        The results are those of `track`. If a frame fails, the frame before is still reported. Without
        `look_ahead`, and with `live` frames, each frame is reported at once. The next live frame is segmented
        ahead only if it is already waiting and a body is tracked. Bodies are searched for between live
        frames.
        """
        look_ahead, pace = look_ahead and live is None, None if live is None else Pace(live.period_s)
        upcoming, unreported = Lookahead(map(self._segment, frames)), list[Updated]()
        try:
            for segmented, clocks in upcoming:
                free, updated = list(segmented.candidates), list[Updated]()
                for n, target in enumerate(self._targets):
                    subject = self._assign(n, segmented, free)
                    target.scene = segmented.change if n == 0 else replace(segmented.change, learned=NOTHING)
                    submitted = target.submit(
                        segmented.frame, subject, segmented.view.planes, clocks[n], pace
                    )
                    # the workers are busy from here until the update
                    if unreported:
                        tracked, unreported = [report(each) for each in unreported], []
                        yield tracked
                    reads = look_ahead or (live is not None and live.is_ready and self._any_is_tracked)
                    self._send_ahead(n + 1, segmented, clocks, upcoming if reads else None)
                    updated.append(submitted if isinstance(submitted, Updated) else target.update(submitted))
                unreported = updated
                if not look_ahead:
                    tracked, unreported = [report(each) for each in unreported], []
                    yield tracked
                if live is not None and pace is not None:
                    if any(each.begins for each in updated):  # it lasts longer than the next one
                        pace = replace(pace, period_s=live.period_s)
                    else:
                        pace = pace.after(clocks, [each.answered for each in updated], live.period_s)
                    self._search_until_ready(live)
        except (Exception, KeyboardInterrupt):
            if unreported:
                yield [report(each) for each in unreported]
            raise
        if unreported:
            yield [report(each) for each in unreported]

    def _send_ahead(
        self,
        n: int,
        segmented: Segmented,
        clocks: list[Stopwatch],
        upcoming: Lookahead[tuple[Segmented, list[Stopwatch]]] | None,
    ) -> None:
        """Send the workers the subject that is next: of the n-th person, or of the next frame."""
        if n < self.people:
            self._targets[n].send_ahead(segmented.subjects[n], clocks[n])
        elif upcoming is not None and (ahead := upcoming.peek()) is not None:
            self._targets[0].send_ahead(ahead[0].subjects[0], ahead[1][0])

    def _search_until_ready(self, live: Live) -> None:
        """Do slices of the searches for bodies until they end; if a body needs it, until a frame waits.

        At least one slice is done for each body that is not tracked.
        """
        untracked = [target for target in self._targets if not target.is_tracked]
        for target in untracked:
            target.search()
        while not (live.is_ready and any(target.needs_frame for target in self._targets)):
            if not any(target.search() for target in (*untracked, *self._targets)):
                break

    def _segment(self, frame: DepthFrame) -> tuple[Segmented, list[Stopwatch]]:
        """A segmented frame, and a stopwatch for each person in it."""
        clocks = [Stopwatch() for _ in self._targets]
        with clocks[0].stage("segment"):
            bodies = [target.expected for target in self._targets]
            rejected = any(target.management.frames_searched > SETTLED_FRAMES for target in self._targets)
            find = any(target.expected is None and not target.is_searching for target in self._targets)
            return self._segmenter.segment(frame, bodies, rejected=rejected, find=find), clocks

    def _assign(self, place: int, segmented: Segmented, free: list[SubjectFrame]) -> SubjectFrame | None:
        """Choose the subject of a person: a free candidate if the person is undetected or lost.

        People are detected in their order. The chosen candidate is removed from `free`.
        """
        target, chosen = self._targets[place], segmented.subjects[place]
        if not target.start.found:
            if not all(each.start.found for each in self._targets[:place]) or not free:
                return None
            chosen = free[target.management.frames_searched // SEARCH_INTERVAL_FRAMES % len(free)]
            if (searched := target.searched_subject) is not None:
                chosen = min(free, key=lambda each: distance(each, middle_of(searched)))
        elif target.expected is None:
            chosen = min(free, key=lambda each: distance(each, target.last_seen), default=None)
        elif target.misses(segmented.pixels(place)):
            chosen = self._find_elsewhere(place, segmented)
        free[:] = [each for each in free if each is not chosen]
        return chosen

    def _find_elsewhere(self, place: int, segmented: Segmented) -> SubjectFrame | None:
        """The present subject, or a candidate nearby with more pixels, who is probably the same person."""
        target, pixels = self._targets[place], segmented.pixels(place)
        others = [each.expected for n, each in enumerate(self._targets) if n != place]
        found = self._segmenter.find_candidates(segmented, [each for each in others if each is not None])
        for each in found[:1]:
            near = distance(each, target.last_seen) < STEP_M
            if each.pixels > pixels and (near or pixels < target.least_pixels):
                target.nothing_seen()
                return each
        return segmented.subjects[place]


def distance(subject: SubjectFrame, place: Array) -> float:
    """Distance in metres from the median of a person's observed points to a place (3,)."""
    return float(np.linalg.norm(middle_of(subject) - place))
