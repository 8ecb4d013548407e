"""Tracks one body through frames that are already segmented.

Each frame takes two steps. `submit` detects the body if its place is in doubt, predicts particles and sends
them to the workers. `update` waits for the refined particles and updates the belief.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from common.bounds import MAX_ITERATIONS
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import joint_positions, natural_angles
from common.settings import RefineSettings, Settings
from coordinator.bodies.tracked import Bodies
from coordinator.filters.belief import Belief, Proposal
from coordinator.filters.gradient_enhanced import Hypotheses
from coordinator.filters.methods import METHODS, apply_method, pace_iterations
from coordinator.scene.planes import Planes
from coordinator.scene.scene import SceneChanges
from coordinator.stopwatch import Stopwatch
from coordinator.tracking.cameras import find_contradicting
from coordinator.tracking.certainty.features import FrameContext
from coordinator.tracking.detector import Candidates, Detection, Detector, Search, Stage
from coordinator.tracking.estimate import MAX_HYPOTHESES, Status
from coordinator.tracking.faults import CameraStates
from coordinator.tracking.gating import LEAST_PIXELS, gate_pose
from coordinator.tracking.known_motion import KnownMotion
from coordinator.tracking.loop import Pace
from coordinator.tracking.observation import distance_of, filter_observation
from coordinator.tracking.refiner import Pending, Refiner
from coordinator.tracking.reporting import Updated, is_settled
from coordinator.tracking.segmenter import PosedBody
from coordinator.tracking.sensor_noise import NO_NOISE, SensorNoise, assume_noise, measure_noise
from coordinator.tracking.size import SizeEstimate, head_to_ankle, likely_stature, measure_stature
from coordinator.tracking.state import (
    Checkpoint,
    Start,
    TrackerState,
    given_start,
    load_generator,
    no_start,
)
from coordinator.tracking.track_management import GIVEN, SEARCH_INTERVAL_FRAMES, TrackManagement

Array = NDArray[np.float64]

SURER_LOG_LIKELIHOOD = 1.0  # by which a detection must explain a frame better than the track does


@dataclass(frozen=True, slots=True, eq=False)
class Submitted:
    """A frame whose particles are with the workers."""

    model: BodyModel
    settings: RefineSettings
    proposal: Proposal[Any]
    pending: Pending
    context: FrameContext
    detection: Detection | None  # of the body elsewhere, if it was searched for
    clock: Stopwatch
    longest_interval_s: float  # by which the iterations are paced


@dataclass(slots=True, eq=False)
class Searching:
    """A search for the body that is under way, or done."""

    search: Search
    subject: SubjectFrame  # in which the body is searched for
    found: Detection | None = None
    sent: Stage | None = None  # to the workers

    def advance(self, *, wait: bool) -> bool:
        """Take the results of a stage and send the next one; False if there is none, or it is not ready.

        With `wait`, they are waited for.
        """
        if self.found is not None or not (wait or self.sent is None or self.sent.is_ready):
            return False
        try:
            self.sent = next(self.search)
        except StopIteration as end:
            self.found = end.value
        return True


class TargetTracker:
    """Tracks one body from frame to frame.

    Args:
        refiner: Refines particles, in this process or on workers.
        settings: What to compute. Settings that define the method replace those given here.
        bodies: The bodies that may be tracked.
        start: Values of degrees of freedom in the first frame; None to detect the body.
        motion: Joint motion as encoders report it.
        state: Resume from here.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        *,
        start: Mapping[str, float] | None = None,
        motion: KnownMotion | None = None,
        state: TrackerState | None = None,
    ) -> None:
        self._refiner = refiner
        self._settings = settings = apply_method(settings)
        self._method = METHODS[settings.method]
        self._bodies = bodies
        self._motion = motion
        self._given = start is not None
        self._detector = Detector(bodies, refiner, settings)
        self.start: Start = no_start(bodies) if start is None else given_start(start, bodies)
        self.management = TrackManagement() if start is None else GIVEN
        self._rng = np.random.default_rng(settings.seed)
        self._belief: Belief | None = None
        self._expected = self.start.pose if self._given else None  # (D,) where the next frame is segmented
        self._time_s: float | None = None  # of the last frame that showed the body
        self._distance = 0.0  # of the subject in the present frame, metres
        self._size: SizeEstimate | None = None  # None if the size is not estimated
        self._searching: Searching | None = None
        self.scenes = SceneChanges()  # what the last submitted frame changed in the scenes
        self.cameras = CameraStates()  # after the last submitted frame
        self.aside: SubjectFrame | None = None  # what cameras that are left out show of the body
        self.left_out: tuple[str, ...] = ()  # cameras, when the next frame is segmented
        self._contradicting: tuple[str, ...] = ()  # the last pose
        if state is not None:
            self._resume(state)

    def _resume(self, state: TrackerState) -> None:
        past = state.checkpoint
        self.start, self.scenes, self.management = state.start, past.scenes, past.management
        self._expected, self._time_s, self._size = past.expected, past.time_s, past.size
        self.cameras, self.left_out, self._contradicting = past.cameras, past.left_out, past.contradicting
        self._rng = load_generator(past.generator)
        if past.belief:
            begun = self._method.begin(self.model, self.start.pose, self._settings.filter)
            self._belief = replace(begun, **past.belief)

    @property
    def model(self) -> BodyModel:
        """The tracked body. Until it is detected, only the names of its joints and DOFs are final."""
        return self.start.model

    @property
    def state(self) -> TrackerState:
        """Everything that the next frame depends on."""
        belief = self._belief
        checkpoint = Checkpoint(
            {} if belief is None else {each.name: getattr(belief, each.name) for each in fields(belief)},
            self._expected,
            self._time_s,
            json.dumps(self._rng.bit_generator.state),
            self.scenes,
            self.management,
            self._size,
            self.cameras,
            self.left_out,
            self._contradicting,
        )
        return TrackerState(self.start, checkpoint)

    @property
    def expected(self) -> PosedBody | None:
        """The body around which the next frame is segmented; None if it may be anywhere.

        The next frame is segmented while the present one is refined. So this is the pose of the frame before
        the present one.
        """
        return None if self._expected is None else PosedBody(self.model, self._expected)

    @property
    def last_seen(self) -> Array:
        """The last known centre (3,) of the body, camera frame, metres."""
        pose = self.start.pose if self._belief is None else self._belief.reported
        middle: Array = joint_positions(self.model, pose[None])[0].mean(axis=0)
        return middle

    @property
    def least_pixels(self) -> int:
        """The smallest number of pixels that can show a body."""
        return min(LEAST_PIXELS, self._settings.points)

    def misses(self, pixels: int) -> bool:
        """Whether so few pixels of the body are visible that it is searched for elsewhere."""
        enough = pixels >= self.management.least_pixels(self._settings.points)
        return self._belief is not None and not enough and self._redetects

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
        return self.is_tracked or (self._belief is not None and not self.search_runs)

    @property
    def is_searching(self) -> bool:
        """Whether the first search for the body is under way: until it ends, no candidate is needed."""
        return self._belief is None and self.search_runs

    @property
    def search_runs(self) -> bool:
        """Whether a search for the body is under way."""
        return self._searching is not None and self._searching.found is None

    @property
    def searched_subject(self) -> SubjectFrame | None:
        """Where the body is being searched for."""
        return None if self._searching is None else self._searching.subject

    def search(self, *, wait: bool = True) -> bool:
        """Go on with the next stage of a search for the body; False if there is none.

        Without `wait`, only if the workers are ready with the last one.
        """
        return self._searching is not None and self._searching.advance(wait=wait)

    def end_search(self) -> None:
        """Give up the search that is under way, if there is one."""
        self._searching = None

    def prepare(self) -> None:
        """Build what a first detection needs, unless the start is given."""
        if not self._given:
            self._detector.prepare()

    def submit(
        self,
        frame: DepthFrame,
        subject: SubjectFrame | None,
        planes: Planes,
        clock: Stopwatch,
        pace: Pace | None = None,
    ) -> Submitted | Updated:
        """Predict particles for the next frame and send them to the workers.

        `update` must follow. If there is nothing to refine, the frame is updated at once. A live frame has
        a pace and does not wait for a search for the body: it begins one, or takes the result of one.
        """
        first = self._belief is None
        expected = self._expected is not None or (first and self._searching is not None)
        shows = subject is not None or (expected and bool(frame.depth.any()))
        self._resize()
        detection = None if subject is None else self._detect(subject, planes, clock, live=pace is not None)
        self._expected, self.left_out = self._whereabouts(), self._contradicting
        if self._belief is None or subject is None:
            status = self._lose(shows=shows)
            return Updated(frame, self.state, self._belief, status, 0, None, clock)
        with clock.stage("draw"):
            proposal = self._predict(self._belief, subject, pace)
        with clock.stage("refine"):
            settings = self._refine_settings
            stretch, past = settings.noise_lateral / settings.noise_depth, self._belief.reported
            context = FrameContext(subject, past, proposal.interval, stretch, first)
            longest_interval_s = math.inf if pace is None else pace.period_s
            pending = self._send(subject, proposal, settings, longest_interval_s)
        return Submitted(
            self.model, settings, proposal, pending, context, detection, clock, longest_interval_s
        )

    def send_ahead(self, subject: SubjectFrame | None, clock: Stopwatch) -> None:
        """Send the subject that will be submitted next to the workers, before its turn."""
        if subject is not None:
            with clock.stage("publish"):
                self._refiner.publish(subject)

    def update(self, submitted: Submitted) -> Updated:
        """Wait for the refined particles of the last submitted frame, and update the belief."""
        frame, clock = submitted.context.subject.frame, submitted.clock
        belief, answered = self._refined(submitted)
        self._time_s = frame.time_s
        with clock.stage("measure"):
            self._accept(belief, submitted)
        return Updated(frame, self.state, self._belief, None, answered, submitted.context, clock)

    @property
    def _redetects(self) -> bool:
        """Whether a lost body is searched for."""
        return self._settings.recover and self._detector.can_redetect(self.start)

    @property
    def _refine_settings(self) -> RefineSettings:
        """The settings for the noise at the distance of the present frame."""
        return assume_noise(self._settings.refine, self.start.noise.at(self._distance))

    def _detect(
        self, subject: SubjectFrame, planes: Planes, clock: Stopwatch, *, live: bool
    ) -> Detection | None:
        """Detect the body if there is none yet; redetect it if its place is in doubt."""
        with clock.stage("search"):
            self._distance = distance_of(subject)
            if self._belief is None and self._given:
                self._begin_at_start(subject)
            elif self._searching is None:
                self._searching = self._begin_search(subject, planes)
            while not live and self.search():
                pass
            detection = self._finish_search(subject)
            if detection is not None and self._belief is None:
                self._begin_at(detection, subject, SEARCH_INTERVAL_FRAMES if live else 1)
                detection = None
        with clock.stage("publish"):
            self._refiner.publish(subject)
        return detection

    def _begin_at_start(self, subject: SubjectFrame) -> None:
        """Begin at the pose that was given."""
        self.start = replace(self.start, noise=self._measure_noise(subject))
        self._belief = self._method.begin(self.model, self.start.pose, self._settings.filter)

    def _measure_noise(self, subject: SubjectFrame) -> SensorNoise:
        return measure_noise(subject.frame) if self._settings.measure_noise else NO_NOISE

    def _begin_search(self, subject: SubjectFrame, planes: Planes) -> Searching | None:
        """A search for the body in a frame, if one is due."""
        if self._belief is not None:
            if not (self.management.check_due and self._redetects):
                return None
            lost, last = self.management.is_lost, self._belief.reported
            search = self._detector.redetect(subject, self.start, self._refine_settings, last, lost=lost)
        elif len(subject.picked) < self.least_pixels:
            self.nothing_seen()
            return None
        elif not self.management.search_due:
            self.management = self.management.not_found(self.management.why)
            return None
        else:
            search = self._detector.detect(subject, self._measure_noise(subject), planes)
        return Searching(search, subject)

    def _finish_search(self, subject: SubjectFrame) -> Detection | None:
        """What was detected, as the present frame shows it; None if no search has ended."""
        searching = self._searching
        if searching is None or searching.found is None:
            return None
        self._searching, found = None, searching.found
        if searching.subject is subject:
            return found
        settings = assume_noise(self._settings.refine, found.start.noise.at(self._distance))
        moved = self._detector.transfer(found, searching.subject, subject, settings)
        # a body that has moved a lot since is not wrong, and may be found again
        return moved if self._belief is not None else replace(moved, gate=found.gate)

    def _begin_at(self, detection: Detection, subject: SubjectFrame, frames: int) -> None:
        """Begin at a detection if it passes gating; else the search counts as so many frames."""
        if not detection.gate.passes:
            self.management = self.management.not_found(detection.gate.why, frames)
            return
        self.start, self.management = detection.start, TrackManagement(why=detection.gate.why)
        self._belief = self._believe(detection.candidates)
        free = set(ROOT_DOFS) <= set(self.model.dof_names)
        if self._settings.measure_person and self._bodies.people and not self._bodies.measures and free:
            self._size = SizeEstimate()
            measured = self._measure_stature(self.start.pose, subject)
            stature = measured or likely_stature(self.start.stature)
            self.start = self.start.with_stature(stature, self._bodies)

    def _believe(self, candidates: Candidates) -> Belief:
        """The belief in candidates: in all of them if the method has several hypotheses, else in the best."""
        begun = self._method.begin(self.model, candidates.poses[0], self._settings.filter)
        if not isinstance(begun, Hypotheses) or self._settings.filter.particles == 1:
            return replace(begun, log_weights=candidates.log_likelihood[:1], residual=candidates.residual[:1])
        return replace(
            begun,
            poses=candidates.poses,
            log_weights=candidates.log_likelihood,
            residual=candidates.residual,
            velocities=np.zeros_like(candidates.poses),
            covariances=np.repeat(begun.covariances, len(candidates.poses), axis=0),
        )

    def _predict(self, belief: Belief, subject: SubjectFrame, pace: Pace | None) -> Proposal[Any]:
        """Particles for the next frame; fewer if it is late, unless the method needs all of them."""
        step = None
        if self._motion is not None:
            step = self._motion.step(self.model, belief.reported, self._time_s, subject.frame.time_s)
        observation = filter_observation(subject, self._time_s, step)
        settings = self._settings.filter
        if pace is not None and self._method.descends:
            fewer = int(min(settings.particles, pace.most_particles))
            settings = msgspec.structs.replace(settings, particles=fewer)
        return self._method.propose(self.model, belief, observation, settings, self._rng)

    def _send(
        self,
        subject: SubjectFrame,
        proposal: Proposal[Any],
        settings: RefineSettings,
        longest_interval_s: float,
    ) -> Pending:
        interval = min(proposal.interval, longest_interval_s)
        paced = pace_iterations(settings, interval, self._settings.pace_iterations, MAX_ITERATIONS)
        covariance = proposal.asks_covariance(paced)
        return self._refiner.submit(
            subject, self.model, proposal.poses, paced, covariance=covariance, velocity=proposal.past.velocity
        )

    def _refined(self, submitted: Submitted) -> tuple[Belief, int]:
        """The belief after refinement, and how many particles it is from; layers ask more than once."""
        model, proposal, pending = submitted.model, submitted.proposal, submitted.pending
        clock, answered = submitted.clock, len(proposal.poses)
        while True:
            with clock.stage("refine"):
                refined = pending.result()
            with clock.stage("merge"):
                answered = min(answered, len(refined.answered))
                refined = replace(refined, poses=natural_angles(model, refined.poses))
                found = self._method.update(model, proposal, refined, self._settings.filter, self._rng)
            if not isinstance(found, Proposal):
                from_guess = submitted.context.first  # the change since a guess is not motion
                return found.at_rest() if from_guess else found, answered
            with clock.stage("refine"):
                proposal = found
                pending = self._send(
                    submitted.context.subject, found, submitted.settings, submitted.longest_interval_s
                )

    def _accept(self, belief: Belief, submitted: Submitted) -> None:
        """Gate the tracked hypotheses; replace them by a detection that explains the frame better."""
        subject, detection, redetected = submitted.context.subject, submitted.detection, False
        gate = gate_pose(belief.log_weights[0], belief.residual[0], submitted.settings)
        self._belief = belief
        if detection is not None:
            if detection.candidates.log_likelihood[0] > belief.log_weights[0] + SURER_LOG_LIKELIHOOD:
                joints = joint_positions(self.model, belief.poses[:1])[0]
                redetected = self.management.is_lost or detection.is_elsewhere(joints)
                self._belief, gate = self._believe(detection.candidates), detection.gate
            joints = joint_positions(self.model, self._belief.poses[:1])[0]
            facing = detection.looks_alike(self.model.joint_names, joints, self._belief.log_weights[0])
            self.management = replace(self.management, ambiguous_facing=facing)
        self.management = self.management.updated(gate, subject.pixels, redetected=redetected)
        views = [*subject.views, *(self.aside.views if self.aside is not None else ())]
        noise = submitted.settings.noise_depth
        self._contradicting = find_contradicting(
            self.model, self._belief.poses[0], views, noise, self._contradicting
        )
        if self._belief is belief:
            self._measure_size(belief, subject)

    def _measure_size(self, belief: Belief, subject: SubjectFrame) -> None:
        """Measure the person's stature in a frame in which the pose is settled."""
        size, time_s = self._size, subject.frame.time_s
        if size is None or not size.is_due(time_s):
            return
        joints = joint_positions(self.model, belief.poses[:MAX_HYPOTHESES])
        if is_settled(self.management, belief.weights[:MAX_HYPOTHESES], joints):
            stature = self._measure_stature(belief.poses[0], subject)
            if stature is not None:
                self._size = size.add(stature, time_s)

    def _measure_stature(self, pose: Array, subject: SubjectFrame) -> float | None:
        """Stature in metres that a frame shows of the person in pose (D,); None if it does not show it."""
        straight = head_to_ankle(self._bodies.full(self.start.stature, self.start.girth))
        return measure_stature(self.model, pose, straight, subject)

    def _resize(self) -> None:
        """Continue with a body of the stature that is known by now."""
        if self._size is not None:
            stature = self._size.revise(self.start.stature)
            self.start = self.start.with_stature(stature, self._bodies)

    def _lose(self, *, shows: bool) -> Status:
        """The status of a frame in which nothing of the body is seen; the hypotheses stay where they are."""
        if self._belief is None:
            if not shows:
                self.nothing_seen()
            searched = self._searching is not None or self.management.frames_searched
            return "searching" if shows and searched else "absent"
        unseen = np.full(len(self._belief.residual), np.nan)
        self._belief = replace(self._belief.at_rest(), residual=unseen)
        self.nothing_seen()
        return "lost" if shows else "absent"

    def _whereabouts(self) -> Array | None:
        """The pose (D,) around which the next frame but one is segmented; None if it may be anywhere."""
        if self._belief is None or (self.management.is_lost and self._redetects):
            return None
        return self._belief.reported
