"""The tracker: depth frames in, estimates of one or more people out.

All input goes through one loop, `Tracker.follow`: segment a frame, predict particles, refine them, update the
hypotheses, report. While the workers refine one frame, the frame before is reported and the next one is
segmented.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Generic, NamedTuple, Self, TypeVar

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import DepthFrame, SubjectFrame
from gepf.common.kinematics import pose_vertices
from gepf.common.settings import Settings
from gepf.coordinator.bodies.tracked import Bodies
from gepf.coordinator.colour.finder import KeypointFinder, Keypoints, fitted_poses, with_keypoints
from gepf.coordinator.scene.scene import NOTHING, SETTLED_FRAMES
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.stopwatch import Stopwatch
from gepf.coordinator.tracking.cameras import CameraStates, watch
from gepf.coordinator.tracking.observation import middle_of
from gepf.coordinator.tracking.particle_filter import Encoders, Pace, Submitted
from gepf.coordinator.tracking.preparation import rehearse
from gepf.coordinator.tracking.refiner import Refiner
from gepf.coordinator.tracking.reporting import Tracked, Updated, report
from gepf.coordinator.tracking.segmenter import Segmented, Segmenter
from gepf.coordinator.tracking.state import TrackerState, first_state
from gepf.coordinator.tracking.target import TargetTracker
from gepf.coordinator.tracking.track_management import SEARCH_INTERVAL_FRAMES

IMAGE_UP = np.array([0.0, -1.0, 0.0])  # in the camera's frame
LARGEST_MOTION_M = 0.8  # largest motion of a body between two frames

Item = TypeVar("Item")


class Ready(NamedTuple):
    """A segmented frame, the state of each camera, and a stopwatch for each person.

    fitted: poses (F, D) for each person that keypoints suggest, if there are any.
    """

    segmented: Segmented
    cameras: CameraStates
    clocks: list[Stopwatch]
    fitted: list[Array]


class Lookahead(Generic[Item]):
    """Iterates over items; `peek` makes the next one before its turn."""

    def __init__(self, items: Iterable[Item]) -> None:
        self._items = iter(items)
        self.was_ahead = False  # whether the last item was made before its turn
        self.is_ahead = False  # whether the next item is made already
        self._next: Item | None = None  # None at the end
        self._error: Exception | None = None

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Item:
        self.was_ahead = self.is_ahead
        item = self.peek()
        self.is_ahead = False
        if self._error is not None:
            raise self._error
        if item is None:
            raise StopIteration
        return item

    def peek(self) -> Item | None:
        """The next item; None at the end, or after an error, which is raised at the item's turn."""
        if not self.is_ahead:
            try:
                self._next = next(self._items, None)
            except Exception as error:  # noqa: BLE001 - no error may affect the item before
                self._next, self._error = None, error
            self.is_ahead = True
        return self._next


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
        colour: Finds keypoints of people in colour images; None: depth alone.
        states: States to resume from, one per person, of a tracker with the same settings.
    """

    def __init__(  # noqa: PLR0913 one parameter an input
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        *,
        people: int = 1,
        scope: Scope | None = None,
        start: Mapping[str, float] | None = None,
        motion: Encoders | None = None,
        colour: KeypointFinder | None = None,
        states: Sequence[TrackerState] | None = None,
    ) -> None:
        states = states or [first_state(bodies, start, settings.seed)] * people
        self._refiner, self._settings, self._bodies = refiner, settings, bodies
        self._colour, self._segmenter = colour, Segmenter(settings.points, scope)
        self._segmenter.recall(states[0].checkpoint.scenes)
        self._cameras = states[0].checkpoint.cameras
        self._targets = tuple(TargetTracker(refiner, settings, bodies, each, motion) for each in states)

    @property
    def states(self) -> list[TrackerState]:
        """Everything that the next frame depends on, one state per person."""
        return [target.state for target in self._targets]

    def prepare(self) -> None:
        """Load and build in advance what the first frames need."""
        self._targets[0].prepare()
        rehearse(self._settings, self._bodies)

    def track(self, frame: DepthFrame) -> list[Tracked]:
        """Track the next frame."""
        (tracked,) = self.follow([frame], look_ahead=False)
        return tracked

    def follow(
        self, frames: Iterable[DepthFrame], *, look_ahead: bool = True, live: LiveFrames | None = None
    ) -> Iterator[list[Tracked]]:
        """Track frames; each frame is reported while the workers refine the next one.

        The results are those of `track`. If a frame fails, the frame before is still reported. Without
        `look_ahead`, each frame is reported at once. So is each `live` frame, after the next one is segmented
        if it waits and a body was known before this frame. Bodies are searched for during live tracking.
        """
        look_ahead, waited = look_ahead and live is None, False
        upcoming, previous = Lookahead(map(self._segment, frames)), list[Updated]()
        try:
            for ready in upcoming:
                late = live is not None and (upcoming.was_ahead or waited or live.is_ready)
                pace = None if live is None else Pace(live.period_s, late)
                followed = any(target.is_tracked for target in self._targets)
                submitted = self._submit(ready, pace)
                # the workers are busy from here until the update
                yield from reported(previous)
                if look_ahead or (live is not None and live.is_ready and followed):
                    self._send_ahead(upcoming)
                    self._search(wait=False)
                pairs = zip(self._targets, submitted, strict=True)
                previous = [one if isinstance(one, Updated) else target.update(one) for target, one in pairs]
                if not look_ahead or not upcoming.is_ahead:
                    yield from reported(previous)
                if live is not None and not upcoming.is_ahead:
                    waited = live.is_ready
                    self._search_until_ready(live)
        except (Exception, KeyboardInterrupt):
            yield from reported(previous)
            raise
        finally:
            for target in self._targets:
                target.end()
        yield from reported(previous)

    def _submit(self, ready: Ready, pace: Pace | None) -> list[Submitted | Updated]:
        """Predict the particles of each person, and send them to the workers."""
        segmented = ready.segmented
        # a person in whom a search has just ended may still be among the candidates
        ended = any(target.begun is not None for target in self._targets)
        free, submitted = [] if ended else list(segmented.candidates), list[Submitted | Updated]()
        for n, target in enumerate(self._targets):
            subject = self._assign(n, segmented, free)
            target.scenes, target.cameras = segmented.changes, ready.cameras
            target.aside = segmented.aside[n]
            if n > 0:
                target.scenes = {name: replace(s, learned=NOTHING) for name, s in target.scenes.items()}
            planes = segmented.planes(subject)
            fitted = ready.fitted[n] if subject is segmented.subjects[n] else ready.fitted[n][:0]
            submitted.append(target.submit(segmented.frame, subject, planes, ready.clocks[n], pace, fitted))
            # the state of a first person who is already updated cannot change any more
            if target.begun and isinstance(submitted[0], Submitted):
                searched, person = target.begun
                others = [each for each in segmented.candidates if each is not searched]
                others += [each for k, each in enumerate(segmented.subjects) if each and k != n]
                first = self._targets[0]
                first.scenes = self._segmenter.learn_things(segmented, first.scenes, searched, person, others)
        return submitted

    def _send_ahead(self, upcoming: Lookahead[Ready]) -> None:
        """Segment the next frame, and send the workers the person's pixels before their turn."""
        ahead = upcoming.peek()
        if ahead is None:
            return
        for subject, clock in zip(ahead.segmented.subjects, ahead.clocks, strict=True):
            if subject is not None:
                with clock.stage("publish"):
                    self._refiner.publish(subject)

    def _search_until_ready(self, live: LiveFrames) -> None:
        """Go on with searches until they end; if a body needs it, until a frame waits."""
        while any(target.searching.runs for target in self._targets):
            needed = any(target.needs_frame for target in self._targets)
            if not self._search(wait=not needed):
                live.wait(0.002)  # seconds between looks at the workers
            if needed and live.is_ready:
                break

    def _search(self, *, wait: bool) -> bool:
        """Do the next stage of one search, of a person who is not tracked if there is any; False if none."""
        ordered = sorted(self._targets, key=lambda target: target.is_tracked)
        return any(target.searching.advance(wait=wait) for target in ordered)

    def _segment(self, frame: DepthFrame) -> Ready:
        """A segmented frame, the state of each camera, and a stopwatch for each person in it."""
        clocks = [Stopwatch() for _ in self._targets]
        for target in self._targets:
            target.begin_frame()
        doubted = [target.doubted for target in self._targets]
        self._cameras, frame = watch(self._cameras, frame, set().union(*doubted))
        with clocks[0].stage("keypoints"):
            seen, fitted = self._look(frame)
        with clocks[0].stage("segment"):
            bodies = [around(*each) for each in zip(self._targets, fitted, strict=True)]
            rejected = any(target.management.frames_searched > SETTLED_FRAMES for target in self._targets)
            find = any(target.needs_candidates for target in self._targets)
            segmented = self._segmenter.segment(frame, bodies, doubted=doubted, rejected=rejected, find=find)
        with clocks[0].stage("keypoints"):
            segmented = self._with_keypoints(segmented, seen)
        return Ready(segmented, self._cameras, clocks, fitted)

    def _look(self, frame: DepthFrame) -> tuple[list[Keypoints], list[Array]]:
        """Keypoints of each person in colour, and the poses that they suggest; before segmentation."""
        bodies = [target.expected_body for target in self._targets]
        if self._colour is None:
            return [{} for _ in bodies], [np.empty((0, 0)) for _ in bodies]
        seen = self._colour.submit(frame, bodies).result()
        return seen, [fitted_poses(*each, frame) for each in zip(bodies, seen, strict=True)]

    def _with_keypoints(self, segmented: Segmented, seen: list[Keypoints]) -> Segmented:
        """The segmented frame with the keypoints of each person, and those of candidates.

        Candidates in whom the network sees a person come first.
        """
        if self._colour is None:
            return segmented
        candidates = list[SubjectFrame]()
        for each in segmented.candidates:
            planes = segmented.planes(each)
            found = self._colour.look_at(each, segmented.frame, planes.up if planes.has_floor else IMAGE_UP)
            candidates.append(with_keypoints(each, found) or each)
        candidates.sort(key=lambda each: all(view.keypoints is None for view in each.views))
        pairs = zip(segmented.subjects, seen, strict=True)
        return replace(
            segmented, subjects=tuple(with_keypoints(*each) for each in pairs), candidates=tuple(candidates)
        )

    def _assign(self, place: int, segmented: Segmented, free: list[SubjectFrame]) -> SubjectFrame | None:
        """Choose the subject of a person: a free candidate if the person is undetected or lost.

        The chosen candidate is removed from `free`.
        """
        target, chosen = self._targets[place], segmented.subjects[place]
        if not target.start.found:
            return self._assign_undetected(place, free)
        if target.needs_candidates:
            chosen = min(free, key=lambda each: distance(each, target.last_seen), default=None)
        elif target.misses(segmented.pixels(place)):
            chosen = self._find_elsewhere(place, segmented)
        if chosen in free:
            free.remove(chosen)
        return chosen

    def _assign_undetected(self, place: int, free: list[SubjectFrame]) -> SubjectFrame | None:
        """Choose the candidate in which a person is searched for: the one under way, or each in turn.

        People are detected in their order. In the first round all cameras of a candidate are used, in each
        further round one of them: cameras with wrong poses show no person together.
        """
        target, count = self._targets[place], len(free)
        if not count or not all(each.start.found for each in self._targets[:place]):
            return None
        rounds, turn = divmod(target.management.frames_searched // SEARCH_INTERVAL_FRAMES, count)
        chosen = free[turn]
        if (searched := target.searching.subject) is not None:
            chosen = min(free, key=lambda each: distance(each, middle_of(searched)))
        free.remove(chosen)
        alone = [replace(view, others=(), wider=()) for view in chosen.views]
        options = [chosen, *alone] if chosen.others else [chosen]
        return options[rounds % len(options)]

    def _find_elsewhere(self, place: int, segmented: Segmented) -> SubjectFrame | None:
        """The present subject, or a candidate nearby with more pixels, who is probably the same person."""
        target, pixels = self._targets[place], segmented.pixels(place)
        others = [each.expected for n, each in enumerate(self._targets) if n != place]
        found = self._segmenter.find_candidates(segmented, [each for each in others if each is not None])
        if (begun := target.begun) is not None:  # the person in whom the search ended
            found = tuple(sorted(found, key=lambda each: distance(each, middle_of(begun.person))))
        for each in found[:1]:
            near = begun is not None or distance(each, target.last_seen) < LARGEST_MOTION_M
            if each.pixels > pixels and (near or pixels < target.least_pixels):
                if begun is None:
                    target.nothing_seen()
                return each
        return segmented.subjects[place]


def around(target: TargetTracker, fitted: Array) -> Array | None:
    """The vertices (V, 3) around which a person is segmented: of the pose that keypoints suggest, if they do.

    If it is farther from the expected pose than a body moves, one of them is wrong: those of both.
    """
    expected = target.expected
    if expected is None or not len(fitted):
        return expected
    seen = pose_vertices(target.model, fitted[:1])[0]
    moved = float(np.linalg.norm(seen - expected, axis=1).mean())
    return seen if moved < LARGEST_MOTION_M else np.concatenate([seen, expected])


def reported(updated: list[Updated]) -> Iterator[list[Tracked]]:
    """The reports of updated frames, if there are any; they are removed from the list."""
    if updated:
        done = [report(each) for each in updated]
        updated.clear()
        yield done


def distance(subject: SubjectFrame, place: Array) -> float:
    """Distance in metres from the median of a person's observed points to a place (3,)."""
    return float(np.linalg.norm(middle_of(subject) - place))
