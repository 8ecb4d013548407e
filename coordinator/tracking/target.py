"""Executes the state machine of one body (`track_state`): searches for it, refines it, and emits events.

A frame takes three steps. For live input, `accept_first_detection` takes over the body that a search has
detected, before the frame is segmented; in a recording the search ends within `submit`, which does the same.
`submit` sends the particles of the frame to the workers. `update` waits for the refined ones. In between,
`continue_refinement` may send the representatives of particles that are merged early, or else `update` does.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import NamedTuple

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.family import Bodies, BodyFamily
from gepf.coordinator.colour.clothes import clothes_in
from gepf.coordinator.colour.matching import NO_MATCH, ExpectedBody, keypoint_cost, match_sides
from gepf.coordinator.filters.belief import USUAL_INTERVAL, Belief
from gepf.coordinator.filters.methods import apply_method
from gepf.coordinator.scene.noise import NO_NOISE, SensorNoise, assume_noise, measure_noise
from gepf.coordinator.settings import Settings
from gepf.coordinator.tracking.cameras import CameraStates, compare_cameras, faults_of
from gepf.coordinator.tracking.certainty import FrameContext
from gepf.coordinator.tracking.detector import Detector, move_root
from gepf.coordinator.tracking.judgement import Gate, gate_pose, judge_pose, max_distance_m
from gepf.coordinator.tracking.observation import SAMPLED_POINTS, camera_points, median_point
from gepf.coordinator.tracking.particle_filter import Encoders, FrameBudget, ParticleFilter, SubmittedPerson
from gepf.coordinator.tracking.pose_candidates import Detection
from gepf.coordinator.tracking.refiner import Refiner
from gepf.coordinator.tracking.reidentification import LostBody
from gepf.coordinator.tracking.reporting import Stopwatch, UpdatedPerson
from gepf.coordinator.tracking.search import BodySearch
from gepf.coordinator.tracking.segmenter import BodyView, DetectedBody, ExpectedSurface, UntrackedPerson
from gepf.coordinator.tracking.state import Checkpoint, PersonState
from gepf.coordinator.tracking.track_state import (
    Body,
    Event,
    Found,
    FrameRefined,
    FrameSegmented,
    Instructions,
    NextSegmentation,
    Policy,
    SearchEnded,
    SearchGivenUp,
    Searching,
    Tracked,
    TrackedBefore,
    step,
)


class Choice(NamedTuple):
    """The hypotheses for a frame: the tracked ones, or those of a search.

    `redetected`: the pose is that of a search, and not where the body was tracked. `ambiguous_facing`: front
    and back look alike in that search; None without a search.
    """

    belief: Belief
    gate: Gate
    redetected: bool = False
    ambiguous_facing: bool | None = None


class TargetTracker:
    """Tracks one body, starting from a given state; the other arguments are those of `Tracker`.

    `start` is the body, `track` the state of its state machine. Settings fixed by the method override those
    passed in.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        state: PersonState,
        motion: Encoders | None = None,
    ) -> None:
        self._refiner = refiner
        self._settings = settings = resolve(settings, bodies.family)
        self._family = bodies.family
        self._filter = ParticleFilter(refiner, settings, bodies.family, motion)
        self._filter.rng.bit_generator.state = json.loads(state.checkpoint.generator)
        self._detector = Detector(bodies, refiner, settings)
        self.search: BodySearch | None = None
        self.start, self.track = state.start, state.track
        self._detected: DetectedBody | None = None

    @property
    def model(self) -> BodyModel:
        """The tracked body. Until it is detected, only the names of its joints and DOFs are final."""
        return self.start.model

    @property
    def state(self) -> PersonState:
        """Everything that the next frame depends on."""
        return PersonState(
            self.start, Checkpoint(self.track, json.dumps(self._filter.rng.bit_generator.state))
        )

    @property
    def policy(self) -> Policy:
        """What the state machine needs to know about the settings and the body."""
        return Policy(
            min_points=min(self._settings.gating.min_points, self._settings.points),
            settings=self._settings.track,
            colour=self._settings.colour,
            recovers=self._settings.recover and self.start.is_free,
        )

    @property
    def next_segmentation(self) -> NextSegmentation:
        """What is known about the body when the next frame is segmented."""
        return self.track.next_segmentation if isinstance(self.track, Body) else NextSegmentation()

    def segmentation_surface(self, motion_m: Array | None = None) -> Array | None:
        """The vertices (V, 3) around which the next frame is segmented; None if the body may be anywhere.

        The current frame may still be in refinement, so the pose is that of the frame before it, unless
        frames are slow. `motion_m` (3,) is the motion since then, if it is known.
        """
        pose = self.next_segmentation.pose
        if pose is None:
            return None
        vertices = np.asarray(pose_vertices(self.model, pose[None])[0])
        return vertices if motion_m is None else vertices + motion_m

    def expected_surface(self, motion_m: Array | None = None) -> ExpectedSurface:
        """Where the body is expected in the next frame; `motion_m` is that of `segmentation_surface`."""
        expected, settings = self.next_segmentation, self._settings
        is_soft = self._settings_at(self.start.noise.distance).is_soft  # it is if the start is noisy
        return ExpectedSurface(
            self.segmentation_surface(motion_m),
            expected.excluded,
            expected.is_new,
            settings.soft_points_factor if is_soft else 1.0,
            expected.followed_s,
        )

    @property
    def expected_body(self) -> ExpectedBody | None:
        """The person around whom the next frame is segmented; None if unknown, or if it is not a person."""
        pose = self.next_segmentation.pose
        return None if pose is None or not len(self.model.keypoint_links) else ExpectedBody(self.model, pose)

    @property
    def explained_body(self) -> ExpectedBody | None:
        """The person in the last frame's pose; None if it does not explain depth, or is not a person's."""
        track = self.track
        if not isinstance(track, Tracked) or track.unexplained_s or track.normalised_residual > 1.0:
            return None
        is_person = len(self.model.keypoint_links) > 0
        return ExpectedBody(self.model, track.belief.reported) if is_person else None

    @property
    def body_with_known_orientation(self) -> ExpectedBody | None:
        """The person in the last pose, if depth and preceding frames leave no doubt which side is left."""
        body, track = self.explained_body, self.track
        is_sure = (
            isinstance(track, Tracked)
            and not track.is_new(self._settings.track)
            and track.is_facing_known(self._settings.colour)
        )
        return body if is_sure else None

    @property
    def _is_new(self) -> bool:
        """Whether the body was detected, or a camera came back, a short time before the last update."""
        track = self.track
        return (
            track.is_new(self._settings.track) if isinstance(track, TrackedBefore) else self.is_just_detected
        )

    @property
    def _is_facing_known(self) -> bool:
        return isinstance(self.track, TrackedBefore) and self.track.is_facing_known(self._settings.colour)

    @property
    def is_just_detected(self) -> bool:
        """Whether the body has been detected, but not yet tracked in any frame."""
        return isinstance(self.track, Found) and not self.track.is_given

    @property
    def last_position(self) -> Array:
        """The last known centre (3,) of the body, rig frame, metres."""
        pose = self.track.belief.reported if isinstance(self.track, Body) else self.start.pose
        return np.asarray(joint_positions(self.model, pose[None])[0].mean(axis=0))

    def lost_body(self, time_s: float) -> LostBody:
        """A lost body: where it was, or is searched for, and for how long it has not been seen."""
        track, searched = self.track, self.searched_person
        assert isinstance(track, Body)
        if searched is not None:
            place, unseen_s = median_point(searched.subject), time_s - searched.subject.time_s
        else:
            place, unseen_s = self.last_position, 0.0 if track.time_s is None else time_s - track.time_s
            unseen_s += track.unexplained_s if isinstance(track, TrackedBefore) else 0.0
        return LostBody(place, max(0.0, unseen_s), track.clothes)

    @property
    def is_tracked(self) -> bool:
        """Whether the body is known and not lost."""
        return isinstance(self.track, Body) and not self.track.is_lost

    @property
    def needs_frame(self) -> bool:
        """Whether the body needs the next frame now: it is tracked, or lost and no search is under way."""
        return self.is_tracked or (isinstance(self.track, Body) and not self.is_searching)

    @property
    def needs_candidates(self) -> bool:
        """Whether the next frame needs candidates.

        It does if a known body may be anywhere in it, or if no search is under way for an unknown one.
        """
        return self.track.may_be_anywhere if isinstance(self.track, Body) else not self.is_searching

    @property
    def is_unconfirmed(self) -> bool:
        """Whether there is a body that colour has not confirmed."""
        return isinstance(self.track, Body) and not self.next_segmentation.is_confirmed

    @property
    def is_searching(self) -> bool:
        """Whether a search for the body is under way."""
        return self.search is not None and self.search.is_running

    @property
    def searched_person(self) -> UntrackedPerson | None:
        """The person in whose pixels the body is searched for, if it may be anywhere."""
        return None if self.search is None else self.search.person

    def is_search_due(self, time_s: float) -> bool:
        """Whether the next search for an unknown body may begin in a frame at this time."""
        if self.is_searching or isinstance(self.track, Body):
            return False
        return not isinstance(self.track, Searching) or self.track.is_due(time_s, self._settings.track)

    @property
    def has_searched_in_vain(self) -> bool:
        """Whether many searches have failed to detect the body."""
        return isinstance(self.track, Searching) and self.track.searches > self._settings.track.max_searches

    @property
    def may_be_anywhere(self) -> bool:
        """Whether a known body may be anywhere in the next frame."""
        return isinstance(self.track, Body) and self.track.may_be_anywhere

    @property
    def is_segmented_at_last_pose(self) -> bool:
        """Whether the next frame is segmented around the last pose, and not around an earlier one."""
        track, pose = self.track, self.next_segmentation.pose
        return (
            isinstance(track, TrackedBefore)
            and pose is not None
            and np.array_equal(pose, track.belief.reported)
        )

    def prepare(self) -> None:
        """Build what a first detection needs, unless the body is known already."""
        if not isinstance(self.track, Body):
            self._detector.prepare()

    def accept_first_detection(self) -> None:
        """Take over the body if a first search has detected it in the meantime."""
        if not isinstance(self.track, Body):
            self._detected = self._end_first_search()

    def cancel_search(self) -> None:
        """Give up a search under way."""
        self.search = None
        self._step(SearchGivenUp())

    def pop_detected_body(self) -> DetectedBody | None:
        """The body that has just been detected; returned only once, to update the background."""
        detected, self._detected = self._detected, None
        return detected

    def submit(
        self, view: BodyView, clock: Stopwatch, budget: FrameBudget | None = None
    ) -> SubmittedPerson | UpdatedPerson:
        """Predict particles for the next frame and send them to the workers.

        `accept_first_detection` must come first, and `update` must follow. If there is nothing to refine, the
        frame is updated at once. A frame with a budget does not wait for a search: the search continues
        during later frames, and this one takes the result of an earlier one.
        """
        waits_for_search = budget is None
        with clock.stage("search"):
            subject = view.subject
            if not isinstance(self.track, Body):  # a search that ends here turns it into a body
                subject = self._search_first(view, wait=waits_for_search)
            if not isinstance(self.track, Body):
                return UpdatedPerson(view.frame, self.state, 0, None, clock)
            todo = self._step_segmented(view, subject)
            settings = self._settings_at(distance_to(view.subject))
            detection = self._search_again(subject, settings, todo, wait=waits_for_search)
        if subject is None or "refine" not in todo:
            return UpdatedPerson(view.frame, self.state, 0, None, clock)
        return self._refine(view, subject, detection, settings, clock, budget)

    def continue_refinement(self, submitted: SubmittedPerson) -> SubmittedPerson:
        """If particles are merged early, wait for their first iterations, and send the representatives."""
        return self._filter.continue_refinement(self.model, submitted)

    def update(self, submitted: SubmittedPerson, cameras: CameraStates) -> UpdatedPerson:
        """Wait for the refined particles of the last submitted frame, and update the state."""
        belief = self._filter.update(self.model, submitted)
        with submitted.clock.stage("measure"):
            confirmed_s = self._settings.track.camera_confirmed_s
            faulty = tuple(faults_of(cameras, submitted.view.frame.time_s, confirmed_s))
            event, context = self._assess(belief, submitted, faulty), submitted.context
            judgement = judge_pose(
                self.model,
                event.belief,
                event.gate.normalised_residual,
                context,
                self._settings,
                is_exact=self._family.is_exact,
                is_new=self._is_new,
                has_fault=any(state.fault for state in cameras.values()),
            )
            todo = self._step(replace(event, is_doubtful=judgement.is_doubtful))
            if "stop searching" in todo:
                self.search = None
        count, clock = submitted.particle_count, submitted.clock
        return UpdatedPerson(submitted.view.frame, self.state, count, judgement, clock)

    def _refine(
        self,
        view: BodyView,
        subject: SubjectFrame,
        detection: Detection | None,
        settings: RefineSettings,
        clock: Stopwatch,
        budget: FrameBudget | None,
    ) -> SubmittedPerson:
        """Predict the particles of a frame and send them to the workers."""
        assert isinstance(self.track, Body)  # it has a belief
        past_is_guess, belief = isinstance(self.track, Found), self.track.belief
        if past_is_guess and budget is not None:
            # with few particles, hypotheses of the detection would be lost
            budget = replace(budget, is_late=False)
        with clock.stage("publish"):
            self._refiner.publish(subject)
        with clock.stage("draw"):
            proposal = self._filter.propose(
                self.model, belief, subject, self.track.time_s, budget, view.motion_m
            )
        with clock.stage("refine"):
            interval, count = proposal.interval, len(proposal.poses)
            settings = self._filter.scale_iterations(settings, interval, budget)
            predicted = proposal.poses[0] if proposal.expected is None else proposal.expected[0]
            context = FrameContext(
                subject, belief.reported, predicted, interval, settings.stretch, past_is_guess
            )
            proposal, pending = self._filter.send_first(self.model, subject, proposal, settings, budget)
        return SubmittedPerson(view, settings, count, proposal, pending, context, detection, clock)

    def _settings_at(self, distance_m: float) -> RefineSettings:
        """The settings of refinement for the camera's noise at a distance."""
        floor_m = self._settings.scene.noise.floor_m
        return assume_noise(self._settings.refine, self.start.noise.at(distance_m, floor_m))

    def _step(self, event: Event) -> Instructions:
        self.track, todo = step(self.track, event, self.policy)
        return todo

    def _step_segmented(self, view: BodyView, subject: SubjectFrame | None) -> Instructions:
        """Handle the event of a segmented frame; measure the noise when a given start is first seen."""
        has_depth = any(image.depth.any() for image in view.frame.views)
        if subject is None:
            event = FrameSegmented(view.frame.time_s, has_depth=has_depth, is_duplicate=view.is_duplicate)
            return self._step(event)
        moved = None
        if isinstance(self.track, Found):
            if self.track.place is None:  # the start is given
                self.start = replace(self.start, noise=self._measure_noise(subject))
            else:
                moved = self._move(self.track.belief, median_point(subject) - self.track.place)
        pixels, points = subject.pixels, len(subject.largest.picked)
        return self._step(
            FrameSegmented(view.frame.time_s, pixels, points, has_depth, view.is_elsewhere, moved)
        )

    def _move(self, belief: Belief, motion_m: Array) -> Belief:
        """The belief about a body that has moved by `motion_m` (3,) since its detection."""
        poses = move_root(self.model, np.vstack([belief.reported, belief.poses]), motion_m)
        return replace(belief, reported=poses[0], poses=poses[1:])

    def _measure_noise(self, subject: SubjectFrame) -> SensorNoise:
        if not self._settings.measure_noise:
            return NO_NOISE
        return measure_noise(subject.largest.image, self._settings.scene.noise)

    def _search_first(self, view: BodyView, *, wait: bool) -> SubjectFrame | None:
        """Search for an unknown body; return the person to refine in this frame, or None if not detected yet.

        That is the detected person after a search in this frame, or else what this frame shows of them.
        """
        subject = view.subject
        todo = self._step_segmented(view, subject)
        if subject is None:
            return None
        if "search" in todo:
            noise = self._measure_noise(subject)
            searched = view.candidate or UntrackedPerson(subject)
            self.search = BodySearch(self._detector.detect(searched, noise, view.planes), searched)
        if wait and self.search is not None:
            self.search.finish()
        self.accept_first_detection()
        if self._detected is None:
            return None
        return self._detected.subject if wait else subject

    def _search_again(
        self, subject: SubjectFrame | None, settings: RefineSettings, todo: Instructions, *, wait: bool
    ) -> Detection | None:
        """Search for a known body as instructed; return the result of the last search, if one has ended.

        The result is refined in this frame, to be compared with the track.
        """
        if "stop searching" in todo:
            self.search = None
        if subject is None:
            return None
        if "search" in todo:
            assert isinstance(self.track, Body)
            belief, lost = self.track.belief, self.track.is_lost
            stages = self._detector.redetect(
                subject, self.start, settings, belief.reported, belief.shape_precision, lost=lost
            )
            self.search = BodySearch(stages, UntrackedPerson(subject) if lost else None)
        if wait and self.search is not None:
            self.search.finish()
        detection = self._pop_detection()
        if detection is None:
            return None
        self._step(SearchEnded())
        return self._detector.transfer(detection, subject, settings)

    def _pop_detection(self) -> Detection | None:
        """The result of a search that has ended, which is then forgotten; None if there is none."""
        detection = None if self.search is None else self.search.detection
        if detection is not None:
            self.search = None
        return detection

    def _end_first_search(self) -> DetectedBody | None:
        """Take over the body that the first search has detected; None if it has detected nothing."""
        searched, detection = self.searched_person, self._pop_detection()
        if searched is None or detection is None:
            return None
        if not detection.gate.passes:
            self._step(SearchEnded(why=detection.gate.why))
            return None
        self.start, person = detection.start, detection.subject
        belief = self._filter.belief_from(self.model, detection.candidates)
        body = ExpectedBody(self.model, belief.reported)
        is_confirmed = match_sides(body, person, self._settings.colour).is_confirmed
        detected = Found(
            belief=belief,
            time_s=person.time_s,
            next_segmentation=NextSegmentation(belief.reported, is_confirmed=is_confirmed),
            place=median_point(person),
            detected_pixels=person.pixels,
            unshown_s=None if is_confirmed else 0.0,
        )
        todo = self._step(SearchEnded(detected))
        vertices = np.asarray(pose_vertices(self.model, belief.reported[None])[0])
        return DetectedBody(searched, person, vertices) if "update the background" in todo else None

    def _choose(self, belief: Belief, submitted: SubmittedPerson) -> Choice:
        """The tracked hypotheses, or those of a detection that explains the frame better."""
        assert isinstance(self.track, Body)  # it was refined
        settings, detection = self._settings, submitted.detection
        subject, refine = submitted.context.subject, submitted.settings
        depth_log_likelihood = depth_log_likelihood_of(
            belief.log_weights[0], self._family, self.model, belief.poses[0], subject, refine
        )
        gate = gate_pose(depth_log_likelihood, belief.residual[0], refine, settings.gating)
        if detection is None:
            return Choice(belief, gate)
        joints = joint_positions(self.model, belief.poses[:1])[0]
        before, after = belief.log_weights[0], detection.candidates.log_posterior[0]
        # left and right may be swapped in colour
        if detection.faces_away(joints)[0] and self._is_facing_known:
            before, after = depth_log_likelihood, detection.depth_log_likelihood[0]
        if not after > before + settings.search.surer_nats:  # also if it is NaN
            return Choice(
                belief,
                gate,
                ambiguous_facing=detection.facing_is_ambiguous(
                    joints, depth_log_likelihood, settings.search.alike_nats
                ),
            )
        redetected = self.track.is_lost or detection.is_elsewhere(joints, settings.certainty.wrong_m)
        chosen = replace(
            self._filter.belief_from(self.model, detection.candidates), shape_precision=belief.shape_precision
        )
        chosen_joints = joint_positions(self.model, chosen.poses[:1])[0]
        ambiguous_facing = detection.facing_is_ambiguous(
            chosen_joints, detection.depth_log_likelihood[0], settings.search.alike_nats
        )
        return Choice(chosen, detection.gate, redetected, ambiguous_facing)

    def _assess(self, belief: Belief, submitted: SubmittedPerson, faulty: tuple[str, ...]) -> FrameRefined:
        """The event of a refined frame."""
        settings, context = self._settings, submitted.context
        chosen = self._choose(belief, submitted)
        belief = chosen.belief
        view, body = submitted.view, ExpectedBody(self.model, belief.poses[0])
        match = NO_MATCH
        if context.subject.has_keypoints:
            match = match_sides(body, context.subject, settings.colour)
        allowed_m = max_distance_m(submitted.settings, settings.gating)
        return FrameRefined(
            belief=belief,
            gate=chosen.gate,
            pixels=context.subject.pixels,
            time_s=context.subject.time_s,
            redetected=chosen.redetected,
            ambiguous_facing=chosen.ambiguous_facing,
            faulty=faulty,
            residuals=self._compare_cameras(chosen, submitted, allowed_m),
            allowed_m=allowed_m,
            # the interval of the first frame includes the search, in which no cameras were compared
            interval_s=USUAL_INTERVAL if context.past_is_guess else submitted.proposal.interval,
            after_gap=view.after_gap,
            # None: colour was not looked at, so the person is neither confirmed nor refuted
            is_confirmed=match.is_confirmed or (False if view.is_looked_at else None),
            sides=-1 if view.is_swapped else match.sides,
            clothes=clothes_in(view.frame, context.subject) if match.is_confirmed else None,
        )

    def _compare_cameras(
        self, choice: Choice, submitted: SubmittedPerson, allowed_m: float
    ) -> dict[str, float]:
        """The residuals of the cameras in a frame, see `compare_cameras`."""
        assert isinstance(self.track, Body)  # it was refined
        agreement, context, view = self.track.agreement, submitted.context, submitted.view
        agreed = agreement.agreed_s >= self._settings.track.camera_confirmed_s and not self.track.is_lost
        return compare_cameras(
            self.model,
            choice.belief.poses[0],
            context.predicted if agreed and not choice.redetected else None,
            view.frame,
            context.subject.views,
            () if view.set_aside is None else view.set_aside.views,
            agreement,
            allowed_m,
        )


def resolve(settings: Settings, family: BodyFamily) -> Settings:
    """The settings after applying the values fixed by the method and those of the body family.

    These are used, and stored with runs. Raises InputError as `apply_method` does.
    """
    settings = apply_method(settings)
    refine = msgspec.structs.replace(settings.refine, outside_weight=family.outside_weight)
    return msgspec.structs.replace(settings, refine=refine)


def depth_log_likelihood_of(
    log_posterior: float,
    family: BodyFamily,
    model: BodyModel,
    pose: Array,
    subject: SubjectFrame,
    settings: RefineSettings,
) -> float:
    """The log likelihood of a tracked pose (D,) from depth alone, without keypoints and family prior."""
    log_likelihood = float(log_posterior - family.log_pose_prior(model, settings, pose[None])[0])
    return log_likelihood + (
        keypoint_cost(ExpectedBody(model, pose), subject) if subject.has_keypoints else 0.0
    )


def distance_to(subject: SubjectFrame | None) -> float:
    """The median distance of a subject from the camera of its largest view, metres; 0 without one."""
    if subject is None or not len(subject.largest.picked):
        return 0.0
    view = subject.largest
    return float(np.median(camera_points(view, max(1, len(view.picked) // SAMPLED_POINTS))[:, 2]))
