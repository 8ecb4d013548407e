"""Tracks one body through frames that are already segmented.

Each frame takes three steps. `begin_frame` takes over the body that a search has found meanwhile. `submit`
detects the body if its place is in doubt, predicts particles and sends them to the workers. `update` waits
for the refined particles and updates the belief.
"""

from __future__ import annotations

import json
from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import DepthFrame, SubjectFrame
from gepf.common.kinematics import joint_positions, pose_vertices
from gepf.common.settings import RefineSettings, Settings
from gepf.coordinator.bodies.tracked import Bodies
from gepf.coordinator.colour.finder import ExpectedBody, keypoint_cost
from gepf.coordinator.filters.belief import USUAL_INTERVAL, Belief
from gepf.coordinator.filters.methods import apply_method
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.stopwatch import Stopwatch
from gepf.coordinator.tracking.cameras import Agreement, camera_residuals, faults_of
from gepf.coordinator.tracking.certainty.features import FrameContext
from gepf.coordinator.tracking.detector import Detector, move_with_points
from gepf.coordinator.tracking.estimate import Status
from gepf.coordinator.tracking.gating import LEAST_PIXELS, gate_pose
from gepf.coordinator.tracking.observation import POINTS, camera_points
from gepf.coordinator.tracking.particle_filter import Encoders, Pace, ParticleFilter, Submitted, suggest
from gepf.coordinator.tracking.pose_candidates import SURER_LOG_LIKELIHOOD, Detection
from gepf.coordinator.tracking.refiner import Refiner
from gepf.coordinator.tracking.reporting import Updated
from gepf.coordinator.tracking.search import BodySearch
from gepf.coordinator.tracking.sensor_noise import NO_NOISE, SensorNoise, assume_noise, measure_noise
from gepf.coordinator.tracking.state import Checkpoint, TrackerState
from gepf.coordinator.tracking.track_management import SEARCH_INTERVAL_FRAMES, TrackManagement

GONE_SHARE = 0.35  # of the body's pixels in the last good frame; with fewer it may have left
WHOLE_SHARE = 0.85  # of the pixels in which the body was detected; with fewer, a part of it is missing


class Begun(NamedTuple):
    """A body that has just been detected: the frame in which it was searched for, and its pixels in it."""

    searched: SubjectFrame
    person: SubjectFrame


class TargetTracker:
    """Tracks one body from frame to frame, from a state on; the other arguments are those of `Tracker`.

    Settings that define the method replace those given here.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        state: TrackerState,
        motion: Encoders | None = None,
    ) -> None:
        self._refiner = refiner
        self._settings = settings = apply_method(settings)
        self._filter = ParticleFilter(refiner, settings, motion)
        self._detector = Detector(bodies, refiner, settings)
        self._distance = 0.0  # of the subject in the present frame, metres
        self.searching = BodySearch()
        self.begun: Begun | None = None  # until the next frame
        self.aside: SubjectFrame | None = None  # what cameras that are left out show of the body
        self.start, past = state.start, state.checkpoint
        self.scenes = past.scenes  # what the last submitted frame changed in the scenes
        self.cameras = past.cameras  # after the last submitted frame
        self.management, self.doubted = past.management, past.doubted
        self._expected, self._time_s = past.expected, past.time_s
        self._agreement, self._faulty = past.agreement, past.faulty
        self._filter.rng.bit_generator.state = json.loads(past.generator)
        self._belief: Belief | None = None
        if past.belief:
            self._belief = replace(self._filter.begin(self.model, self.start.pose), **past.belief)

    @property
    def model(self) -> BodyModel:
        """The tracked body. Until it is detected, only the names of its joints and DOFs are final."""
        return self.start.model

    @property
    def state(self) -> TrackerState:
        """Everything that the next frame depends on."""
        belief = self._belief
        checkpoint = Checkpoint(
            belief={each.name: getattr(belief, each.name) for each in (fields(belief) if belief else ())},
            expected=self._expected,
            time_s=self._time_s,
            generator=json.dumps(self._filter.rng.bit_generator.state),
            scenes=self.scenes,
            management=self.management,
            cameras=self.cameras,
            doubted=self.doubted,
            faulty=self._faulty,
            agreement=self._agreement,
        )
        return TrackerState(self.start, checkpoint)

    @property
    def expected(self) -> Array | None:
        """The vertices (V, 3) around which the next frame is segmented; None if the body may be anywhere.

        The present frame is still being refined. So this is the pose of the frame before.
        """
        return None if self._expected is None else pose_vertices(self.model, self._expected[None])[0]

    @property
    def expected_body(self) -> ExpectedBody | None:
        """The person around whom the next frame is segmented; None if there is none, or it is no person."""
        if self._expected is None or not len(self.model.keypoint_links):
            return None
        return ExpectedBody(self.model, self._expected)

    @property
    def last_seen(self) -> Array:
        """The last known centre (3,) of the body, camera frame, metres."""
        pose = self.start.pose if self._belief is None else self._belief.reported
        return np.asarray(joint_positions(self.model, pose[None])[0].mean(axis=0))

    @property
    def least_pixels(self) -> int:
        """The smallest number of pixels that can show a body."""
        return min(LEAST_PIXELS, self._settings.points)

    def misses(self, pixels: int) -> bool:
        """Whether so few pixels of the body are visible that it is searched for elsewhere."""
        least = max(self.least_pixels, GONE_SHARE * self.management.pixels)
        if self.begun is not None:
            least = WHOLE_SHARE * self.begun.person.pixels
        return self._belief is not None and pixels < least and self._redetects

    def nothing_seen(self) -> None:
        """Note that the present frame does not show the body where it was expected."""
        self.management = self.management.nothing_seen()

    @property
    def is_tracked(self) -> bool:
        """Whether the body is found and not lost."""
        return self.start.found and not self.management.is_lost

    @property
    def needs_frame(self) -> bool:
        """Whether the body needs the next frame now: it is tracked, or lost and no search is under way."""
        return self.is_tracked or (self._belief is not None and not self.searching.runs)

    @property
    def needs_candidates(self) -> bool:
        """Whether the body may be anywhere in the next frame, and no first search for it runs."""
        return self._expected is None and not (self._belief is None and self.searching.runs)

    def prepare(self) -> None:
        """Build what a first detection needs, unless the body is known already."""
        if not self.start.found:
            self._detector.prepare()

    def begin_frame(self) -> None:
        """Begin at the body that a search has found meanwhile, if it has; before a frame is segmented."""
        self.begun = None
        self._begin_if_found(live=True)  # a search in a recording ends with its frame

    def end(self) -> None:
        """Give up what the workers do for later frames."""
        self.searching.end()

    def submit(
        self,
        frame: DepthFrame,
        subject: SubjectFrame | None,
        planes: Planes,
        clock: Stopwatch,
        pace: Pace | None = None,
        fitted: Array | None = None,
    ) -> Submitted | Updated:
        """Predict particles for the next frame and send them to the workers.

        `fitted` (F, D) are poses that keypoints suggest; some particles are replaced by them.

        `begin_frame` comes before, and `update` must follow. If there is nothing to refine, the frame is
        updated at once. A live frame has a pace and does not wait for a search for the body: it begins one,
        or takes the result of an earlier one.
        """
        first = self._belief is None or self.begun is not None
        expected = self._expected is not None or (first and self.searching.subject is not None)
        shows = subject is not None or (expected and any(view.depth.any() for view in frame.views))
        detection = None
        if subject is not None:
            detection, subject = self._detect(subject, planes, clock, live=pace is not None)
        if subject is not None and self._belief is not None and self.begun is not None:
            poses = np.vstack([self._belief.reported, self._belief.poses])
            poses = move_with_points(self.model, poses, self.begun.person, subject)
            self._belief = replace(self._belief, reported=poses[0], poses=poses[1:])
        anywhere = self.management.is_lost and self._redetects
        self._expected = None if self._belief is None or anywhere else self._belief.reported
        self.doubted = self._agreement.contradicting
        if self._belief is None or subject is None:
            status = self._lose(shows=shows)
            return Updated(frame, self.state, self._belief, status, 0, None, clock)
        if first and pace is not None:  # with few particles, hypotheses of the detection would be lost
            pace = replace(pace, is_late=False)
        with clock.stage("draw"):
            proposal = self._filter.propose(self.model, self._belief, subject, self._time_s, pace)
            if fitted is not None and self.begun is None:
                proposal = suggest(proposal, fitted, self.model.shape_count)
        with clock.stage("refine"):
            rules = self._filter.pace(self._refine_settings, proposal.interval, pace)
            context = FrameContext(subject, self._belief.reported, proposal.interval, rules.stretch, first)
            pending = self._filter.send(self.model, subject, proposal, rules)
        return Submitted(frame, rules, proposal, pending, context, detection, clock)

    def update(self, submitted: Submitted) -> Updated:
        """Wait for the refined particles of the last submitted frame, and update the belief."""
        frame, clock = submitted.context.subject.frame, submitted.clock
        belief, answered = self._filter.update(self.model, submitted)
        self._time_s = frame.time_s
        with clock.stage("measure"):
            self._accept(belief, submitted)
        return Updated(frame, self.state, self._belief, None, answered, submitted.context, clock)

    @property
    def _redetects(self) -> bool:
        """Whether a lost body is searched for."""
        return self._settings.recover and self.start.is_free

    @property
    def _refine_settings(self) -> RefineSettings:
        """The settings for the noise at the distance of the present frame."""
        return assume_noise(self._settings.refine, self.start.noise.at(self._distance))

    def _detect(
        self, subject: SubjectFrame, planes: Planes, clock: Stopwatch, *, live: bool
    ) -> tuple[Detection | None, SubjectFrame]:
        """Detect the body if there is none yet; redetect it if its place is in doubt.

        Returns a redetection, and the subject. After a detection in this frame, it is what showed the body.
        """
        with clock.stage("search"):
            points = camera_points(subject, max(1, len(subject.picked) // POINTS))
            self._distance = float(np.median(points[:, 2])) if len(points) else 0.0
            if self._belief is None and self.start.found:
                self.start = replace(self.start, noise=self._measure_noise(subject))
                self._belief = self._filter.begin(self.model, self.start.pose)
            elif self.searching.subject is None:
                self._begin_search(subject, planes)
            while not live and self.searching.advance():
                pass
            self._begin_if_found(live=live)
            detection = self.searching.take()
            if detection is not None:
                detection = self._detector.transfer(detection, subject, self._refine_settings)
            if self.begun is not None and not live:
                subject = self.begun.person
        with clock.stage("publish"):
            self._refiner.publish(subject)
        return detection, subject

    def _measure_noise(self, subject: SubjectFrame) -> SensorNoise:
        return measure_noise(subject.frame) if self._settings.measure_noise else NO_NOISE

    def _begin_search(self, subject: SubjectFrame, planes: Planes) -> None:
        """Begin a search for the body in a frame, if one is due."""
        if self._belief is not None:
            if self.management.check_due and self._redetects:
                lost, last, rules = self.management.is_lost, self._belief.reported, self._refine_settings
                precision = self._belief.shape_precision
                search = self._detector.redetect(subject, self.start, rules, last, precision, lost=lost)
                self.searching.begin(search, subject)
        elif len(subject.picked) < self.least_pixels:
            self.nothing_seen()
        elif not self.management.search_due:
            self.management = self.management.not_found(self.management.why)
        else:
            search = self._detector.detect(subject, self._measure_noise(subject), planes)
            self.searching.begin(search, subject)

    def _begin_if_found(self, *, live: bool) -> None:
        """Begin at the result of a first search, in its frame, if it passes gating.

        Else the search counts as one frame, live as all until the next one.
        """
        searched = self.searching.subject
        if self._belief is not None or searched is None or (detection := self.searching.take()) is None:
            return
        if not detection.gate.passes:
            frames = SEARCH_INTERVAL_FRAMES if live else 1
            self.management = self.management.not_found(detection.gate.why, frames)
            return
        self.start, self.management = detection.start, TrackManagement(why=detection.gate.why)
        self._belief = self._filter.believe(self.model, detection.candidates)
        self.begun = Begun(searched, detection.subject)
        self._time_s, self._expected = detection.subject.frame.time_s, self._belief.reported

    def _accept(self, belief: Belief, submitted: Submitted) -> None:
        """Gate the tracked hypotheses; replace them by a detection that explains the frame better."""
        subject, detection, redetected = submitted.context.subject, submitted.detection, False
        by_depth = belief.log_weights[0] + keypoint_cost(self.model, belief.poses[0], subject)
        gate = gate_pose(by_depth, belief.residual[0], submitted.rules)
        self._belief = belief
        if detection is not None:
            if detection.candidates.log_likelihood[0] > belief.log_weights[0] + SURER_LOG_LIKELIHOOD:
                joints = joint_positions(self.model, belief.poses[:1])[0]
                redetected = self.management.is_lost or detection.is_elsewhere(joints)
                redetected_as = self._filter.believe(self.model, detection.candidates)
                self._belief = replace(redetected_as, shape_precision=belief.shape_precision)
                gate = detection.gate
            joints = joint_positions(self.model, self._belief.poses[:1])[0]
            facing = detection.looks_alike(self.model.joint_names, joints, self._belief.log_weights[0])
            self.management = replace(self.management, ambiguous_facing=facing)
        if self.management.is_lost and not self._agreement.contradicting:
            self._agreement = Agreement()
        self.management = self.management.updated(gate, subject.pixels, redetected=redetected)
        before, self._faulty = self._faulty, tuple(faults_of(self.cameras, submitted.frame.time_s))
        if set(before) - set(self._faulty) and self._redetects:  # a camera is back
            self.searching.end()  # it began without this camera
            self.management = self.management.checked_next()
        views = [*subject.views, *(self.aside.views if self.aside is not None else ())]
        pose, noise = self._belief.poses[0], submitted.rules.noise_depth
        residuals = camera_residuals(self.model, pose, submitted.frame, views, noise)
        # the interval of the first frame includes the search, in which no cameras were compared
        interval = USUAL_INTERVAL if submitted.context.first else submitted.proposal.interval
        self._agreement = self._agreement.after(residuals, noise, interval)

    def _lose(self, *, shows: bool) -> Status:
        """The status of a frame in which nothing of the body is seen; the hypotheses stay where they are."""
        if self._belief is None:
            if not shows:
                self.nothing_seen()
            searched = self.searching.subject is not None or self.management.frames_searched
            return "searching" if shows and searched else "absent"
        resting = self._belief.at_rest()
        self._belief = replace(resting, residual=np.full(len(resting.residual), np.nan))
        self.nothing_seen()
        return "lost" if shows else "absent"
