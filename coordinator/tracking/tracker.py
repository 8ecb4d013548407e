"""The tracker: depth frames in, estimates of one or more people out, in one loop: `Tracker.follow`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from gepf.common.frame import Frame
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.colour.agreement import compare, unused
from gepf.coordinator.colour.finder import KeypointFinder
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.settings import Settings
from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.stopwatch import Stopwatch
from gepf.coordinator.tracking.assignment import Assignment
from gepf.coordinator.tracking.cameras import CameraStates, watch
from gepf.coordinator.tracking.colour import ColouredFrame, ColourWatch, Look, Sight, with_own_keypoints
from gepf.coordinator.tracking.pacing import Live, Lookahead, Recorded, advance_search
from gepf.coordinator.tracking.particle_filter import Encoders, FrameBudget, Submitted
from gepf.coordinator.tracking.preparation import warm_up
from gepf.coordinator.tracking.refiner import Refiner
from gepf.coordinator.tracking.reporting import TrackedFrame, Updated, report
from gepf.coordinator.tracking.segmenter import SegmentedFrame, Segmenter
from gepf.coordinator.tracking.state import FrameState, TrackerState, first_state
from gepf.coordinator.tracking.target import TargetTracker
from gepf.coordinator.tracking.track_state import ROUNDING_S, Body, Searching


@dataclass(frozen=True, slots=True, eq=False)
class PreparedFrame:
    """A segmented frame, the state of its cameras, what colour shows, and a stopwatch for each person.

    interval_s: time since the previous frame, seconds; 0 for the first. is_slow: it exceeds
    `max_lookahead_s`.
    """

    segmented: SegmentedFrame
    cameras: CameraStates
    is_slow: bool
    clocks: Sequence[Stopwatch]
    sight: Sight
    interval_s: float


class SubmittedFrame(NamedTuple):
    """A frame whose particles are with the workers (or that is already updated), with the frame's state."""

    people: list[Submitted | Updated]
    state: FrameState
    prepared: PreparedFrame


class UpdatedFrame(NamedTuple):
    """A frame that is not reported yet."""

    people: list[Updated]
    state: FrameState


class Tracker:
    """Tracks one body, or several people, through a sequence of frames.

    Args:
        refiner: Refines particles, in this process or on workers.
        settings: What to compute, for each person.
        bodies: The bodies that may be tracked.
        people: Largest number of people; they are numbered in the order of their detection.
        scope: Which part of the scene counts, and which person is selected.
        start: Values of degrees of freedom in the first frame, metres and radians; None to detect the body.
        motion: Joint motion as measured by encoders.
        colour: Finds keypoints of people in colour images; None: depth alone.
        state: State to resume from, of a tracker with the same settings.
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
        state: TrackerState | None = None,
    ) -> None:
        state = state or TrackerState([first_state(bodies, start, settings)] * people)
        self._refiner, self._settings, self._bodies = refiner, settings, bodies
        self._colour = colour
        self._watch = ColourWatch(colour, settings.colour)
        self._segmenter = Segmenter(settings.points, settings.scene, scope)
        self._segmenter.recall(state.frame.scenes)
        self._frame = state.frame
        self._is_late = False  # whether the last live frame was late
        self._cameras, self._time_s = state.frame.cameras, state.frame.time_s  # of the last segmented frame
        self._targets = [TargetTracker(refiner, settings, bodies, person, motion) for person in state.people]

    @property
    def state(self) -> TrackerState:
        """Everything that the next frame depends on."""
        return TrackerState([target.state for target in self._targets], self._frame)

    def prepare(self) -> None:
        """Load and build in advance what the first frames need."""
        self._targets[0].prepare()
        if self._colour is not None:
            self._colour.prepare()
        warm_up(self._settings, self._bodies)

    def track(self, frame: Frame) -> TrackedFrame:
        """Track the next frame."""
        (tracked,) = self.follow([frame], look_ahead=False)
        return tracked

    def follow(
        self, frames: Iterable[Frame], *, look_ahead: bool = True, live: LiveFrames | None = None
    ) -> Iterator[TrackedFrame]:
        """Track frames; each frame is reported while the workers refine the next one.

        The results are those of `track`. If a frame fails, the previous frame is still reported. Without
        `look_ahead`, each frame is reported at once. So is each `live` frame, see `Live`. A frame is
        segmented around the pose from two frames earlier; at low rates, around that from the previous frame.
        """
        # a frame is read and segmented at its turn; or by `peek`, while the workers refine the frame before
        upcoming = Lookahead(map(self._segment, frames))
        pacing = Recorded(look_ahead=look_ahead) if live is None else Live(live, upcoming)
        updated = list[UpdatedFrame]()  # at most one frame, which is not reported yet
        try:
            for prepared in upcoming:
                budget = pacing.begin_frame(self._targets)
                self._is_late = budget is not None and budget.is_late
                submitted = self._submit(prepared, budget)  # predict, refine
                # the workers are busy from here until the update
                yield from reported(updated, self._settings)
                if pacing.looks_ahead and not prepared.is_slow:
                    self._send_ahead(upcoming.peek())
                    advance_search(self._targets, wait=False)
                updated = [self._update(submitted)]  # update, assess
                if pacing.reports_at_once:
                    yield from reported(updated, self._settings)
                pacing.end_frame(self._targets)
        except (Exception, KeyboardInterrupt):
            yield from reported(updated, self._settings)
            raise
        finally:
            for target in self._targets:
                target.end()
        yield from reported(updated, self._settings)

    def _segment(self, frame: Frame) -> PreparedFrame:
        """Segment a frame around the poses of people, look at them in colour, and check its cameras."""
        settings, clocks = self._settings.track, [Stopwatch() for _ in self._targets]
        for target in self._targets:
            target.take_search()
        with clocks[0].stage("segment"):
            tracks = [target.track for target in self._targets]
            excluded = [track.excluded if isinstance(track, Body) else () for track in tracks]
            self._cameras, frame = watch(self._cameras, frame, set().union(*excluded))
            last_s, self._time_s = self._time_s, frame.time_s
            interval_s = 0.0 if last_s is None else frame.time_s - last_s
            is_slow = interval_s > settings.max_lookahead_s + ROUNDING_S
            bodies = [target.expected_body for target in self._targets]
            look = self._watch.begin(frame, bodies, is_late=self._is_late)
            sight = Sight.of_nobody(len(self._targets))
            if look is not None and is_slow:  # people may have moved far since the last frame
                is_trusted = not unused(self._frame.colours, last_s)
                usable = [is_trusted and target.is_confirmed for target in self._targets]
                sight = replace(sight, steps=look.steps(usable, settings.max_motion_m))
            segmented = self._segmenter.segment(
                frame,
                [
                    target.segmentation_surface(step)
                    for target, step in zip(self._targets, sight.steps, strict=True)
                ],
                excluded=excluded,
                rejected=any(isinstance(t, Searching) and t.searches > settings.max_searches for t in tracks),
                find=any(target.needs_candidates for target in self._targets),
            )
        if look is not None:
            with clocks[0].stage("keypoints"):
                sight = self._see(look, segmented, sight, interval_s)
                segmented = with_own_keypoints(segmented, sight.people.keypoints)
        return PreparedFrame(segmented, self._cameras, is_slow, clocks, sight, interval_s)

    def _see(self, look: Look, segmented: SegmentedFrame, sight: Sight, interval_s: float) -> Sight:
        """What a look at a segmented frame shows: people, and candidates if somebody is searched for."""
        people, time_s = look.people.result(), segmented.frame.time_s
        unknown = [target for target in self._targets if not isinstance(target.track, Body)]
        is_lost = any(target.may_be_anywhere for target in self._targets)
        if is_lost or any(target.is_search_due(time_s) for target in unknown[:1]):  # one after another
            return replace(sight, people=people, candidates=look.candidates(segmented, interval_s))
        return replace(sight, people=people)

    def _submit(self, prepared: PreparedFrame, budget: FrameBudget | None) -> SubmittedFrame:
        """Predict the particles of each person, and send them to the workers."""
        colours, scenes = self._frame.colours, prepared.segmented.changes
        facing = [target.body_with_known_orientation for target in self._targets]
        coloured = ColouredFrame(prepared.segmented, prepared.sight, colours, facing, self._settings.colour)
        segmented = coloured.segmented
        assignment = Assignment(self._targets, self._segmenter, segmented, coloured.free)
        submitted = list[Submitted | Updated]()
        for person_index, (target, clock) in enumerate(zip(self._targets, prepared.clocks, strict=True)):
            view = replace(assignment.view_of(person_index), is_slow=prepared.is_slow)
            view = coloured.complete(view, person_index, is_at_last_pose=target.is_segmented_at_last_pose)
            submitted.append(target.submit(view, clock, budget))
            if (detected := target.take_detected()) is not None:
                others = assignment.other_people(person_index, detected.searched)
                scenes = self._segmenter.learn_things(segmented, scenes, *detected, others)
        self._frame = FrameState(scenes, prepared.cameras, colours, segmented.frame.time_s)
        return SubmittedFrame(submitted, self._frame, prepared)

    def _send_ahead(self, prepared: PreparedFrame | None) -> None:
        """Send the workers the people's pixels of the next frame before their turn."""
        if prepared is None:
            return
        for subject, clock in zip(prepared.segmented.subjects, prepared.clocks, strict=True):
            if subject is not None:
                with clock.stage("publish"):
                    self._refiner.publish(subject)

    def _update(self, frame: SubmittedFrame) -> UpdatedFrame:
        """Wait for the refined particles of each person, and update the states."""
        people = [
            target.update(person, frame.state.cameras) if isinstance(person, Submitted) else person
            for target, person in zip(self._targets, frame.people, strict=True)
        ]
        bodies = [target.explained_body for target in self._targets]
        prepared, settings = frame.prepared, self._settings.colour
        image, keypoints = prepared.segmented.frame, prepared.sight.people.keypoints
        colours = compare(frame.state.colours, image, bodies, keypoints, prepared.interval_s, settings)
        self._frame = replace(frame.state, colours=colours)
        return UpdatedFrame(people, self._frame)


def reported(updated: list[UpdatedFrame], settings: Settings) -> Iterator[TrackedFrame]:
    """The reports of updated frames, if there are any; they are removed from the list."""
    while updated:
        people, state = updated.pop(0)
        yield TrackedFrame([report(person, state.cameras, settings) for person in people], state)
