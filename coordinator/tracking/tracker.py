"""The tracker: depth frames in, estimates of one or more people out, in one loop: `Tracker.follow`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import Frame
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.colour.agreement import compare, unused_before, with_agreement
from gepf.coordinator.colour.finder import KeypointFinder
from gepf.coordinator.scene.scene import SceneChanges
from gepf.coordinator.scene.scope import Scope
from gepf.coordinator.settings import Settings
from gepf.coordinator.sources.live import LiveFrames
from gepf.coordinator.tracking.assignment import Assignment
from gepf.coordinator.tracking.cameras import CameraStates, update_camera_states
from gepf.coordinator.tracking.colour import (
    ColouredFrame,
    KeypointDetections,
    KeypointScheduler,
    KeypointSearch,
    with_own_keypoints,
)
from gepf.coordinator.tracking.pacing import LivePacing, Lookahead, RecordedPacing, advance_search
from gepf.coordinator.tracking.particle_filter import Encoders, FrameBudget, SubmittedPerson
from gepf.coordinator.tracking.refiner import Refiner
from gepf.coordinator.tracking.reporting import Stopwatch, TrackedFrame, UpdatedPerson, report
from gepf.coordinator.tracking.segmenter import DetectedBody, SegmentedFrame, Segmenter, UntrackedPerson
from gepf.coordinator.tracking.state import FrameState, TrackerState, first_state
from gepf.coordinator.tracking.target import TargetTracker
from gepf.coordinator.tracking.track_state import ROUNDING_S, Body
from gepf.coordinator.tracking.warm_up import warm_up

LOOKS_AROUND = 1  # distinguishes these random numbers from others of the same frame


@dataclass(frozen=True, slots=True, eq=False)
class PreparedFrame:
    """A segmented frame, the state of its cameras, and a stopwatch for each person.

    interval_s: time since the previous frame, seconds; 0 for the first. after_gap: whether that time exceeds
    `max_lookahead_s`; the next frame is then prepared only after the update, around newer poses. detections:
    what colour shows; None without colour.
    """

    segmented: SegmentedFrame
    cameras: CameraStates
    interval_s: float
    after_gap: bool
    clocks: Sequence[Stopwatch]
    detections: KeypointDetections | None


class SubmittedFrame(NamedTuple):
    """A frame whose particles are with the workers; people without particles are updated already."""

    people: list[SubmittedPerson | UpdatedPerson]
    scene_changes: SceneChanges
    prepared: PreparedFrame


class UpdatedFrame(NamedTuple):
    """A frame that has not been reported yet."""

    people: list[UpdatedPerson]
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
        state: State to resume from, with all scene changes so far, of a tracker with the same settings.
    """

    def __init__(  # noqa: PLR0913 one parameter per input
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
        scene_settings, extents = settings.scene, bodies.family.extents(bodies)
        if extents is not None:
            scene_settings = scene_settings.scaled(*extents)
        self._segmenter = Segmenter(settings.points, scene_settings, scope, bodies.family.body_network())
        self._segmenter.restore(state.frame.scene_changes)
        self._keypoint_scheduler = KeypointScheduler(colour, settings.colour)
        self._prepared_cameras, self._prepared_s = state.frame.cameras, state.frame.time_s
        self._frame = state.frame  # of the last updated frame; it may be one frame behind the prepared one
        self._is_late = False  # whether the last submitted live frame was late
        self._targets = [TargetTracker(refiner, settings, bodies, person, motion) for person in state.people]

    @property
    def state(self) -> TrackerState:
        """The state after the last frame; of the scenes, only what that frame changed."""
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
        `look_ahead`, each frame is reported at once. So is each `live` frame (see `LivePacing`). A frame is
        segmented around the pose from two frames earlier; at low rates, around that from the previous frame.
        """
        # a frame is prepared when its turn comes, or earlier by `peek`, while workers refine the previous one
        upcoming = Lookahead(map(self._prepare, frames))
        pacing = RecordedPacing(look_ahead=look_ahead) if live is None else LivePacing(live, upcoming)
        updated = list[UpdatedFrame]()  # at most one frame, which has not been reported yet
        try:
            for prepared in upcoming:
                budget = pacing.begin_frame(self._targets)
                self._is_late = budget is not None and budget.is_late
                submitted = self._submit(prepared, budget)  # predict, refine
                # the workers are busy from here until the update, except while particles are merged
                yield from pop_reports(updated, self._settings)
                if pacing.looks_ahead and not prepared.after_gap:
                    self._send_ahead(upcoming.peek())
                    advance_search(self._targets, wait=False)
                submitted = self._continue_refinement(submitted)
                updated = [self._update(submitted)]  # update, assess
                if pacing.reports_at_once:
                    yield from pop_reports(updated, self._settings)
                pacing.end_frame(self._targets)
        except (Exception, KeyboardInterrupt):
            yield from pop_reports(updated, self._settings)
            raise
        finally:
            for target in self._targets:
                target.cancel_search()
        yield from pop_reports(updated, self._settings)

    def _prepare(self, frame: Frame) -> PreparedFrame:
        """Compare the cameras of a frame, segment it around the people, and look at them in colour.

        First, the results of searches that have ended in the meantime are taken over.
        """
        targets, limits = self._targets, self._settings.track
        clocks = [Stopwatch() for _ in targets]
        for target in targets:
            target.accept_first_detection()
        with clocks[0].stage("segment"):
            excluded_by_any = set[str]().union(*(target.next_segmentation.excluded for target in targets))
            self._prepared_cameras, frame = update_camera_states(
                self._prepared_cameras, frame, excluded_by_any
            )
            last_s, self._prepared_s = self._prepared_s, frame.time_s
            interval_s = 0.0 if last_s is None else frame.time_s - last_s
            keypoint_search, steps = self._begin_keypoint_search(frame, interval_s, last_s)
            is_searched = any(target.needs_candidates for target in targets)
            looks_around = keypoint_search is not None and self._is_look_due(frame, last_s)
            segmented = self._segmenter.segment(
                frame,
                [target.expected_surface(step) for target, step in zip(targets, steps, strict=True)],
                rejected=not is_searched or any(target.has_searched_in_vain for target in targets),
                find=is_searched or looks_around,
            )
        detections = KeypointDetections.of_nobody(len(targets)) if frame.has_colours else None
        if keypoint_search is not None:
            with clocks[0].stage("keypoints"):
                finds = looks_around or searches_for_anybody(targets, frame.time_s)
                detections = keypoint_search.detections(segmented, steps, interval_s, finds_candidates=finds)
                segmented = with_own_keypoints(segmented, detections.people.keypoints)
        after_gap = interval_s > limits.max_lookahead_s + ROUNDING_S
        return PreparedFrame(segmented, self._prepared_cameras, interval_s, after_gap, clocks, detections)

    def _is_look_due(self, frame: Frame, last_s: float | None) -> bool:
        """Whether to look at candidates in colour because a body may not be a person.

        A person among them shows that colour works here: a body that it does not show is then probably not a
        person. Frames are drawn at random, `check_interval_s` apart on average, whatever their rate; while
        frames are late, colour looks at few of them, and all of these are taken.
        """
        unconfirmed = any(target.is_unconfirmed for target in self._targets)
        if not unconfirmed or last_s is None or unused_before(self._frame.colours, last_s):
            return False
        share = 1.0 if self._is_late else (frame.time_s - last_s) / self._settings.track.check_interval_s
        return bool(np.random.default_rng([frame.number, LOOKS_AROUND]).random() < share)

    def _begin_keypoint_search(
        self, frame: Frame, interval_s: float, last_s: float | None
    ) -> tuple[KeypointSearch | None, list[Array | None]]:
        """Begin the search for keypoints; return it, and each person's motion (3,) since `last_s`, if known.

        The search is None if the frame is not searched. While frames are late, fewer frames are searched.
        """
        targets, limits, keypoint_search = self._targets, self._settings.track, None
        if frame.has_colours:
            bodies = [target.expected_body for target in targets]
            keypoint_search = self._keypoint_scheduler.begin(frame, bodies, is_late=self._is_late)
        # in twice the longest interval for looking ahead, people walk out of reach of their last pose
        if keypoint_search is None or interval_s <= 2.0 * limits.max_lookahead_s + ROUNDING_S:
            return keypoint_search, [None] * len(targets)
        # whether or not the last frame has been updated yet, what was known before it counts
        is_trusted = not unused_before(self._frame.colours, last_s)
        usable = [is_trusted and target.next_segmentation.is_confirmed for target in targets]
        return keypoint_search, keypoint_search.steps(usable, limits.max_motion_m)

    def _submit(self, prepared: PreparedFrame, budget: FrameBudget | None) -> SubmittedFrame:
        """Predict the particles of each person, send them to the workers, and learn the scene."""
        segmented, coloured = prepared.segmented, None
        free: Sequence[UntrackedPerson] = segmented.candidates
        if prepared.detections is not None:
            oriented = [target.body_with_known_orientation for target in self._targets]
            states, settings = self._frame.colours, self._settings.colour
            coloured = ColouredFrame(segmented, prepared.detections, states, oriented, settings)
            segmented, free = coloured.segmented, coloured.free
        assignment = Assignment(self._targets, self._segmenter, segmented, free)
        submitted, detected = list[SubmittedPerson | UpdatedPerson](), list[DetectedBody]()
        for person_index, (target, clock) in enumerate(zip(self._targets, prepared.clocks, strict=True)):
            view = replace(assignment.view_of(person_index), after_gap=prepared.after_gap)
            if coloured is not None:
                view = coloured.complete(view, person_index, is_at_last_pose=target.is_segmented_at_last_pose)
            submitted.append(target.submit(view, clock, budget))
            if (body := target.pop_detected_body()) is not None:
                detected.append(body._replace(others=assignment.other_people(person_index, body.searched)))
        with prepared.clocks[0].stage("segment"):
            scene_changes = self._segmenter.learn(segmented, detected)
        return SubmittedFrame(submitted, scene_changes, prepared)

    def _send_ahead(self, prepared: PreparedFrame | None) -> None:
        """Send the workers the people's pixels in the next frame before that frame is submitted."""
        if prepared is None:
            return
        for subject, clock in zip(prepared.segmented.subjects, prepared.clocks, strict=True):
            if subject is not None:
                with clock.stage("publish"):
                    self._refiner.publish(subject)

    def _continue_refinement(self, frame: SubmittedFrame) -> SubmittedFrame:
        """Send the representatives of the particles that are merged early, of each person."""
        people = [
            target.continue_refinement(person) if isinstance(person, SubmittedPerson) else person
            for target, person in zip(self._targets, frame.people, strict=True)
        ]
        return frame._replace(people=people)

    def _update(self, frame: SubmittedFrame) -> UpdatedFrame:
        """Wait for the refined particles of each person, and update the states."""
        prepared, settings = frame.prepared, self._settings.colour
        people = [
            target.update(person, prepared.cameras) if isinstance(person, SubmittedPerson) else person
            for target, person in zip(self._targets, frame.people, strict=True)
        ]
        image, colours = prepared.segmented.frame, self._frame.colours
        if prepared.detections is not None:
            bodies = [target.explained_body for target in self._targets]
            keypoints, subjects = prepared.detections.people.keypoints, prepared.segmented.subjects
            colours = compare(colours, image, bodies, subjects, keypoints, prepared.interval_s, settings)
            showing_candidates = set[str]().union(*prepared.detections.candidates.values())
            colours = with_agreement(colours, showing_candidates, image.time_s)
        self._frame = FrameState(frame.scene_changes, prepared.cameras, colours, image.time_s)
        return UpdatedFrame(people, self._frame)


def searches_for_anybody(targets: Sequence[TargetTracker], time_s: float) -> bool:
    """Whether anybody is searched for in a frame at this time; of unknown people, only the first is."""
    unknown = [target for target in targets if not isinstance(target.track, Body)]
    is_lost = any(target.may_be_anywhere for target in targets)
    return is_lost or any(target.is_search_due(time_s) for target in unknown[:1])


def pop_reports(updated: list[UpdatedFrame], settings: Settings) -> Iterator[TrackedFrame]:
    """The reports of updated frames, if there are any; they are removed from the list."""
    while updated:
        people, state = updated.pop(0)
        yield TrackedFrame([report(person, state.cameras, settings) for person in people], state)
