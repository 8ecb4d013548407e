"""One tracker: depth frames in, estimates out.

A frame's way: `submit` cuts it out, publishes it, draws particles and sends them to the workers; `collect`
waits for them and updates the belief; `report` gives the estimate. `track` does all three.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.bounds import most_iterations
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import joint_positions, natural_angles
from common.refinement import Refined
from common.settings import RefineSettings, Settings
from common.sizes import Body
from coordinator.bodies.tracked import Bodies
from coordinator.filters.belief import Belief
from coordinator.filters.methods import METHODS, apply_method
from coordinator.filters.proposal import Proposal
from coordinator.scene.room.planes import Planes
from coordinator.scene.scene import SceneChange
from coordinator.tracking.certainty.evidence import Sighted
from coordinator.tracking.estimate import RECORDED, Estimate, Status
from coordinator.tracking.known_motion import KnownMotion
from coordinator.tracking.observing.isolation import Isolation, PosedBody
from coordinator.tracking.observing.sensor_noise import SensorNoise, assume_noise, measure_noise
from coordinator.tracking.observing.sighting import distance_of, see, some_points
from coordinator.tracking.pace import pace_iterations
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.reporting import Reported, report
from coordinator.tracking.search.company import has_company
from coordinator.tracking.search.facing import looks_alike
from coordinator.tracking.search.search import ways_of
from coordinator.tracking.search.seeker import Finding, Seeker
from coordinator.tracking.search.settling import begin_with
from coordinator.tracking.search.stages import rounds
from coordinator.tracking.search.verdict import FEWEST, weigh
from coordinator.tracking.search.watch import CHOOSY, GIVEN, Watch
from coordinator.tracking.starting.asking import Question
from coordinator.tracking.starting.person_size import PersonSize
from coordinator.tracking.starting.start import Start, given_start, no_start
from coordinator.tracking.state import TrackerState, load_generator, take_checkpoint
from coordinator.tracking.status import is_settled
from coordinator.tracking.step import CutOut, Request, Submitted, Tracked
from coordinator.tracking.stopwatch import Stopwatch

Array = NDArray[np.float64]

SURELY = 1.0  # log likelihood by which what is found elsewhere must explain a frame better
APART = 3  # iterations for bodies of several sizes, where particles do not descend
STEP = 1.0  # metres that a body may go between two frames


class Tracker:
    """Follows one body through a sequence.

    Args:
        refiner: Has particles refined, here or elsewhere.
        settings: What to compute. What makes their method holds whatever else they say.
        bodies: Gives the body that is tracked, by its measures.
        start: Values of degrees of freedom in the first frame, metres and radians; None to find the body.
        state: Go on from here, where another tracker of the same settings left off.
        isolation: Cuts the body out of the frames; None for the usual way.
        known: How joints move, as encoders report it.
        choosy: Wait for a frame that shows the body well, for some searches: it is not the only one there.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        start: Mapping[str, float] | None = None,
        state: TrackerState | None = None,
        isolation: Isolation | None = None,
        known: KnownMotion | None = None,
        *,
        choosy: bool = False,
    ) -> None:
        self._refiner = refiner
        self._settings = settings = apply_method(settings)
        self._method = METHODS[settings.method]
        self._bodies = bodies
        self._given = start is not None
        self._choosy = choosy
        self._start = no_start(bodies) if start is None else given_start(start, bodies)
        self._seeker = Seeker(bodies, refiner, settings.refine, ways_of(settings.rotate_deg))
        self._size = PersonSize(bodies)
        self._rng = np.random.default_rng(settings.seed)
        self._belief: Belief | None = None
        self._watch = Watch() if start is None else GIVEN
        self._around = None if start is None else self._start.pose  # (D,) near which the next frame shows it
        self._time_s: float | None = None  # of the last frame that showed something
        self._known = known
        self._distance = 0.0  # metres, of what the frame at hand shows
        self._ahead: CutOut | None = None  # the next frame, cut out before its turn
        self._isolation = isolation or Isolation(settings.points)
        self._verdict: Array | None = None  # (J, 2) about each joint, of the frame that was reported last
        self._scene = SceneChange()  # what the frame that was submitted last changed in it
        if state is not None:
            self._scene = state.checkpoint.scene
            self._isolation.recall(self._scene)
            self._around, self._watch = state.checkpoint.around, state.checkpoint.watch
            self._time_s, self._size.measured = state.checkpoint.time_s, state.checkpoint.measured
            self._verdict = state.checkpoint.verdict
            self._rng = load_generator(state.checkpoint.generator)
            self._start = self._size.resume(state.start)
            if state.checkpoint.belief:
                self._belief = replace(self._begin_at(self._start.pose), **state.checkpoint.belief)

    @property
    def start(self) -> Start:
        """The body and pose that tracking began with; nobody's until somebody is found."""
        return self._start

    @property
    def model(self) -> BodyModel:
        """The body that is tracked. Until it is found, all but names may change."""
        return self._start.model

    @property
    def state(self) -> TrackerState:
        """All that the next frame goes on from."""
        checkpoint = take_checkpoint(
            self._belief, self._around, self._time_s, self._rng, self._scene, self._watch, self._size.measured
        )
        checkpoint = replace(checkpoint, verdict=self._verdict)
        return TrackerState(self._start, checkpoint)

    @property
    def expected(self) -> PosedBody | None:
        """The body near which the next frame shows it; None where it may be anywhere."""
        pose = self._whereabouts()
        return None if pose is None else PosedBody(self.model, pose)

    @property
    def last_seen(self) -> Array:
        """Where the body's middle (3,) was last, camera frame, metres."""
        pose = self._start.pose if self._belief is None else self._belief.reported
        middle: Array = joint_positions(self.model, pose[None])[0].mean(axis=0)
        return middle

    @property
    def watch(self) -> Watch:
        """How it went lately."""
        return self._watch

    def hurry(self) -> None:
        """Look for the body in the next frame, even if that failed just now."""
        self._watch = replace(self._watch, pause=0)

    @property
    def rules(self) -> RefineSettings:
        """How particles are refined: the settings, for the noise at the distance of the frame at hand."""
        return assume_noise(self._settings.refine, self._start.noise.at(self._distance))

    def prepare(self) -> None:
        """Make what a first search and the person's size need, where they are looked for."""
        if not self._given:
            self._seeker.prepare()
            self._size.prepare()

    def track(self, frame: DepthFrame) -> Estimate:
        """Follow the body into the next frame, or look for it."""
        return self.report(self.collect(self.submit(frame))).estimate

    def submit(self, frame: DepthFrame) -> Submitted:
        """Draw particles for the next frame and let the workers refine them; `collect` has to follow."""
        cut, self._ahead = self._cut_out(frame), None
        return self.submit_cut(self._look_about(cut))

    def submit_cut(self, cut: CutOut) -> Submitted:
        """The same for a frame out of which the body was cut by somebody else."""
        frame = cut.frame
        first, clock, subject = self._belief is None, cut.clock, cut.isolated.subject
        self._start = self._size.give(self._start)
        self._scene = cut.isolated.change
        if subject is None:
            elsewhere = self._around is not None and bool(frame.depth.any())
            self._around = self._whereabouts()
            return Submitted(frame, None, None, elsewhere, None, first, clock)
        with clock.stage("publish"):
            self._refiner.publish(subject)
            self._distance = distance_of(subject)
        with clock.stage("search"):
            rival = self._look(subject, cut.isolated.view.planes)
        if self._belief is None:
            return Submitted(frame, None, None, True, None, first, clock)
        self._around = self._whereabouts()
        self._mind_company(cut, self._belief, first=first)
        with clock.stage("draw"):
            sighting = see(subject, self._time_s, self._known_step(frame))
            proposal = self._method.propose(
                self.model, self._belief, sighting, self._settings.filter, self._rng
            )
        with clock.stage("refine"):
            rules = self.rules
            stretch = rules.noise_lateral / rules.noise_depth
            lone = len(proposal.poses) == 1
            sighted = Sighted(subject, self._belief.reported, proposal.interval, stretch, lone, first)
            question = self._ask(proposal.poses[0], frame.time_s) if self._descends else None
            request = self._request(proposal, question)
            return Submitted(frame, request, sighted, True, rival, first, clock)

    def send_ahead(self, frame: DepthFrame | None) -> None:
        """Cut out the frame that comes next, and let the workers have it before its turn."""
        if frame is None:
            return
        self._ahead = self._cut_out(frame)
        self.send_cut_ahead(self._ahead)

    def send_cut_ahead(self, cut: CutOut) -> None:
        """Let the workers have what will be submitted next."""
        if cut.isolated.subject is not None:
            with cut.clock.stage("publish"):
                self._refiner.send_ahead(cut.isolated.subject)

    def collect(self, submitted: Submitted) -> Tracked:
        """Wait for the refined particles of the frame that was submitted last, and update the belief."""
        answered, status = 0, None
        if submitted.request is None:
            status = self._lose(submitted)
        else:
            found, answered, answer = self._update(submitted.request, submitted.clock)
            self._time_s = submitted.frame.time_s
            if submitted.first:
                found = found.at_rest()  # the way from a guess is no motion
            self._belief = self._decide(found, submitted.rival)
            if submitted.sighted is not None:
                subject = submitted.sighted.subject
                self._watch = self._watch.shown(subject.pixels)
                with submitted.clock.stage("measure"):
                    if self._belief is found:
                        self._hear(submitted.request, answer, found.poses[0], subject)
        return Tracked(
            submitted.frame, self.state, self._belief, status, answered, submitted.sighted, submitted.clock
        )

    def report(self, tracked: Tracked) -> Reported:
        """What was found in a frame that was collected; before the next one is collected."""
        reported = report(tracked)
        self._verdict = reported.state.checkpoint.verdict
        return reported

    def _look_about(self, cut: CutOut) -> CutOut:
        """The frame with whoever is seen elsewhere, if next to nothing is where the body was."""
        near = 0 if cut.isolated.subject is None else cut.isolated.subject.pixels
        if self._belief is None or not self._recovers or near >= self._watch.fewest(self._settings.points):
            return cut
        with cut.clock.stage("isolate"):
            found = self._isolation.anybody(cut.frame, cut.isolated.view)
        if found is None or found.pixels <= near:
            return cut
        if near >= min(FEWEST, self._settings.points) and not self._within_a_step(found):
            return cut
        self._watch = self._watch.saw_nobody()
        return replace(cut, isolated=replace(cut.isolated, subject=found))

    def _within_a_step(self, found: SubjectFrame) -> bool:
        """Whether somebody is where the body may have gone since the last frame."""
        middle = np.median(some_points(found), axis=0)
        return bool(np.linalg.norm(middle - self.last_seen) < STEP)

    def _look(self, subject: SubjectFrame, planes: Planes) -> Finding | None:
        """Find the body, if there is none yet, or where else it may be, if that is in doubt."""
        if self._belief is None:
            self._find(subject, planes)
            return None
        if not (self._watch.checks and self._recovers):
            return None
        return self._seeker.find_again(subject, self._start, self.rules, self._belief.reported)

    def _mind_company(self, cut: CutOut, belief: Belief, *, first: bool) -> None:
        """Note who else stands there, when the body was found or when something is unexplained."""
        asks = self._bodies.people and not self._choosy and (first or self._watch.unexplained > 0)
        if asks and has_company(cut.isolated.view, PosedBody(self.model, belief.reported).surface):
            self._watch = self._watch.accompanied()

    def _find(self, subject: SubjectFrame, planes: Planes) -> None:
        """Begin where the body is given or found, if what is found can be believed."""
        noise = measure_noise(subject.frame) if self._settings.measure_noise else SensorNoise()
        if self._given:
            self._start = replace(self._start, noise=noise)
            self._belief = self._begin_at(self._start.pose)
        elif len(subject.picked) < min(FEWEST, self._settings.points):
            self._watch = self._watch.saw_nobody()
        elif self._watch.pause > 0:
            self._watch = self._watch.waited()
        else:
            finding = self._seeker.find(subject, noise, planes)
            eager = not self._choosy or self._watch.failures >= CHOOSY
            if finding.verdict.stands if eager else finding.convinces:
                self._start, self._belief = finding.start, self._begin_with(finding)
                if self._settings.measure_person:
                    self._start = self._size.guess(self._start)
                self._watch = Watch(why=finding.verdict.why)
            else:
                self._watch = self._watch.failed(finding.verdict.why, subject.pixels)

    @property
    def _recovers(self) -> bool:
        return self._settings.recover and self._seeker.can_find_again(self._start)

    def _lose(self, submitted: Submitted) -> Status:
        """Nothing of the body was seen: hypotheses stay where they are."""
        if self._belief is None:
            return "searching" if submitted.shows and self._watch.failures else "absent"
        unseen = np.full(len(self._belief.residual), np.nan)
        self._belief = replace(self._belief.at_rest(), residual=unseen)
        self._watch = self._watch.saw_nobody()
        return "lost" if submitted.shows else "absent"

    def _decide(self, followed: Belief, rival: Finding | None) -> Belief:
        """The hypotheses that were followed, or those that were found elsewhere, if they are likelier."""
        verdict = weigh(followed.log_weights[0], followed.residual[0], self.rules)
        anew = False
        if rival is not None and rival.standing.log_likelihood[0] > followed.log_weights[0] + SURELY:
            anew = self._watch.seeks or rival.is_elsewhere(self._joints_of(followed))
            followed, verdict = self._begin_with(rival), rival.verdict
        self._watch = self._watch.followed(verdict, anew=anew)
        if rival is not None:
            self._watch = self._watch.searched(alike=self._looks_alike(followed, rival))
        return followed

    def _looks_alike(self, believed: Belief, rival: Finding) -> bool:
        """Whether a search found the body the other way round, about as likely."""
        joints = self._joints_of(believed)
        return looks_alike(self.model.joint_names, rival.standing, joints, believed.log_weights[0])

    def _joints_of(self, belief: Belief) -> Array:
        """Positions (J, 3) of the likeliest hypothesis' joints, camera frame, metres."""
        joints: Array = joint_positions(self.model, belief.poses[:1])[0]
        return joints

    def _begin_with(self, finding: Finding) -> Belief:
        """The belief in what was found."""
        return begin_with(self._method, finding.start.model, finding.standing, self._settings.filter)

    def _ask(self, pose: Array, time_s: float) -> Question | None:
        """What to ask about the person's size where a pose (D,) is expected, if the belief is settled."""
        question = self._size.ask(self._start, pose, time_s, self.rules)
        return question if question is not None and self._is_settled else None

    def _hear(self, request: Request, answer: Refined, pose: Array, subject: SubjectFrame) -> None:
        """Take in what a frame says of the person's size, if the pose (D,) that it shows is settled."""
        question = request.question
        if not self._descends:  # the sizes have to
            question = self._ask(pose, subject.frame.time_s)
            if question is not None:
                rules = rounds(self.rules, APART)
                answer = self._refiner.submit(question.bodies, question.poses, rules).result()
        if question is not None and self._is_settled:
            self._size.hear(question, answer, self._start, pose, subject)

    @property
    def _descends(self) -> bool:
        return self._settings.refine.icp_iterations > 0

    @property
    def _is_settled(self) -> bool:
        if self._belief is None:
            return False
        poses, weights = self._belief.poses[:RECORDED], self._belief.weights[:RECORDED]
        return is_settled(self._watch, weights, joint_positions(self.model, poses))

    def _request(self, proposal: Proposal[Any], question: Question | None = None) -> Request:
        body: Body = self.model
        poses, settings = proposal.poses, self._settings
        if question is not None:
            body, poses = question.beside(self.model, poses)
        most = most_iterations(poses.shape, settings.points, len(self.model.vertices))
        refine = pace_iterations(self.rules, proposal.interval, settings.pace_iterations, most)
        return Request(proposal, self._refiner.submit(body, poses, refine), question)

    def _update(self, request: Request, clock: Stopwatch) -> tuple[Belief, int, Refined]:
        """The belief after a frame, of how many particles at the least, and what was asked beside them.

        Layers ask for more than once.
        """
        answered = len(request.proposal.poses)
        answer: Refined | None = None
        while True:
            with clock.stage("refine"):
                refined, beside = request.pending.result().divide(len(request.proposal.poses))
                answer = answer or beside
            with clock.stage("merge"):
                answered = min(answered, len(refined.answered))
                refined = replace(refined, poses=natural_angles(self.model, refined.poses))
                found = self._method.update(
                    self.model, request.proposal, refined, self._settings.filter, self._rng
                )
            if not isinstance(found, Proposal):
                return found, answered, answer
            with clock.stage("refine"):
                request = self._request(found)

    def _cut_out(self, frame: DepthFrame) -> CutOut:
        """What is near the body as it was two frames ago: so it can be cut out while the last is refined."""
        if self._ahead is not None and self._ahead.frame is frame:
            return self._ahead
        clock = Stopwatch()
        with clock.stage("isolate"):
            return CutOut(frame, self._isolation.cut(frame, self._body()), clock)

    def _body(self) -> PosedBody | None:
        """Near what a frame is cut out; None where the body may be anywhere."""
        return None if self._around is None else PosedBody(self.model, self._around)

    def _whereabouts(self) -> Array | None:
        """The pose (D,) near which the next frame but one shows the body; None where it may be anywhere.

        That frame is cut out before this one is collected, so it is what is known before this one.
        """
        if self._belief is None or (self._watch.seeks and self._recovers):
            return None
        return self._belief.reported

    def _known_step(self, frame: DepthFrame) -> Array | None:
        """What encoders say of the motion (D,) since the frame before."""
        if self._known is None or self._belief is None:
            return None
        return self._known.step(self.model, self._belief.reported, self._time_s, frame.time_s)

    def _begin_at(self, pose: Array) -> Belief:
        return self._method.begin(self.model, pose, self._settings.filter)
