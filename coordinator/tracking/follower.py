"""Follows a body through frames out of which somebody else has cut it: a tracker alone, or several people's.

A frame's way: `submit_cut` publishes it, looks for the body where that is in doubt, draws particles and sends
them to the workers; `collect` waits for them and updates the belief; `report` gives the estimate.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from common.frame import SubjectFrame
from common.kinematics import joint_positions
from common.settings import RefineSettings, Settings
from coordinator.bodies.tracked import Bodies, scaled
from coordinator.filters.belief import Belief
from coordinator.filters.methods import apply_method
from coordinator.scene.scene import SceneChange
from coordinator.tracking.estimate import RECORDED, Status
from coordinator.tracking.inference import Answer, Inference, Situation
from coordinator.tracking.known import Known
from coordinator.tracking.observing.company import has_company
from coordinator.tracking.observing.isolation import PosedBody
from coordinator.tracking.observing.lookout import CutOut
from coordinator.tracking.observing.sensor_noise import assume_noise
from coordinator.tracking.observing.sighting import distance_of
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.reporting import Reported, report
from coordinator.tracking.rival import decide
from coordinator.tracking.search.finder import Finder
from coordinator.tracking.search.seeker import Finding, Seeker
from coordinator.tracking.search.watch import GIVEN, Watch
from coordinator.tracking.size import SizeEstimate, head_to_ankle, measure_stature
from coordinator.tracking.starting.start import USUAL_MEASURES, Start
from coordinator.tracking.state import TrackerState, take_checkpoint
from coordinator.tracking.status import is_settled
from coordinator.tracking.step import Submitted, Tracked

Array = NDArray[np.float64]


class Follower:
    """Follows one body from frame to frame.

    Args:
        refiner: Has particles refined, here or elsewhere.
        settings: What to compute. What makes their method holds whatever else they say.
        bodies: Gives the body that is tracked, by its measures.
        known: What is known of it beside the frames; None for nothing.
        choosy: Wait for a frame that shows the body well, for some searches: it is not the only one there.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        known: Known | None = None,
        *,
        choosy: bool = False,
    ) -> None:
        known = known or Known()
        given = known.start is not None
        self._refiner = refiner
        self._settings = settings = apply_method(settings)
        self._minds_company = bodies.people and not choosy
        self._start = known.begin(bodies)
        self._bodies = bodies
        self._size: SizeEstimate | None = None  # None where the size is not sought
        self._rng = known.generator(settings.seed)
        self._belief: Belief | None = None
        self._watch = GIVEN if given else Watch()
        self._around = self._start.pose if given else None  # (D,) near which the next frame shows it
        self._time_s: float | None = None  # of the last frame that showed something
        self._distance = 0.0  # metres, of what the frame at hand shows
        self._verdict: Array | None = None  # (J, 2) about each joint, of the frame that was reported last
        self._scene = SceneChange()  # what the frame that was submitted last changed in it
        self._inference = Inference(refiner, settings, self._rng, known.motion)
        seeker = Seeker(bodies, refiner, settings, choosy=choosy)
        self._finder = Finder(seeker, self._inference, settings, given=given)
        if known.state is not None:
            self._resume(known.state)

    def _resume(self, state: TrackerState) -> None:
        """Know what was known."""
        checkpoint = state.checkpoint
        self._scene, self._verdict = checkpoint.scene, checkpoint.verdict
        self._around, self._watch, self._time_s = checkpoint.around, checkpoint.watch, checkpoint.time_s
        self._size = checkpoint.size
        self._start = state.start
        if checkpoint.belief:
            begun = self._inference.begin(self.model, self._start.pose)
            self._belief = replace(begun, **checkpoint.belief)

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
        known = (self._belief, self._around, self._time_s, self._rng, self._scene, self._watch, self._verdict)
        return TrackerState(self._start, take_checkpoint(*known, self._size))

    @property
    def expected(self) -> PosedBody | None:
        """The body near which the next frame shows it; None where it may be anywhere."""
        pose = self._whereabouts()
        return None if pose is None else PosedBody(self.model, pose)

    @property
    def near(self) -> PosedBody | None:
        """The body near which a frame is cut out before the one at hand is collected; None for anywhere."""
        return None if self._around is None else PosedBody(self.model, self._around)

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

    def misses(self, cut: CutOut) -> bool:
        """Whether a frame shows next to nothing where the body was, and it is looked for elsewhere."""
        enough = cut.pixels >= self._watch.fewest(self._settings.points)
        return self._belief is not None and not enough and self._finder.recovers(self._start)

    def saw_nobody(self) -> None:
        """Know that the next frame does not show the body where it was."""
        self._watch = self._watch.saw_nobody()

    def hurry(self) -> None:
        """Look for the body in the next frame, even if that failed just now."""
        self._watch = replace(self._watch, pause=0)

    @property
    def rules(self) -> RefineSettings:
        """How particles are refined: the settings, for the noise at the distance of the frame at hand."""
        return assume_noise(self._settings.refine, self._start.noise.at(self._distance))

    def prepare(self) -> None:
        """Make what a first search and the person's size need, where they are looked for."""
        self._finder.prepare()

    def submit_cut(self, cut: CutOut) -> Submitted:
        """Draw particles for the next frame and let the workers refine them; `collect` has to follow."""
        first, subject = self._belief is None, cut.isolated.subject
        shows = subject is not None or (self._around is not None and bool(cut.frame.depth.any()))
        self._resize()
        self._scene = cut.isolated.change
        rival = None if subject is None else self._look(cut, subject)
        self._around = self._whereabouts()
        if self._belief is None or subject is None:
            return Submitted(cut.frame, None, shows, None, cut.clock)
        self._mind_company(cut, self._belief, first=first)
        situation = self._situation(self._belief)
        with cut.clock.stage("draw"):
            proposal = self._inference.draw(self.model, self._belief, subject, self._time_s)
        with cut.clock.stage("refine"):
            request = self._inference.submit(situation, proposal, subject, first=first)
        return Submitted(cut.frame, request, shows, rival, cut.clock)

    def send_cut_ahead(self, cut: CutOut) -> None:
        """Let the workers have what will be submitted next, before its turn."""
        if cut.isolated.subject is not None:
            with cut.clock.stage("publish"):
                self._refiner.send_ahead(cut.isolated.subject)

    def collect(self, submitted: Submitted) -> Tracked:
        """Wait for the refined particles of the frame that was submitted last, and update the belief."""
        frame, request, clock = submitted.frame, submitted.request, submitted.clock
        if request is None:
            status = self._lose(submitted)
            return Tracked(frame, self.state, self._belief, status, 0, None, clock)
        answer = self._inference.answer(request, clock)
        self._time_s = frame.time_s
        with clock.stage("measure"):
            self._believe(answer, request.sighted.subject, submitted.rival)
        return Tracked(frame, self.state, self._belief, None, answer.answered, request.sighted, clock)

    def report(self, tracked: Tracked) -> Reported:
        """What was found in a frame that was collected; before the next one is collected."""
        reported = report(tracked)
        self._verdict = reported.state.checkpoint.verdict
        return reported

    def _look(self, cut: CutOut, subject: SubjectFrame) -> Finding | None:
        """Find the body, if there is none yet, or where else it may be, if that is in doubt."""
        with cut.clock.stage("publish"):
            self._refiner.publish(subject)
            self._distance = distance_of(subject)
        with cut.clock.stage("search"):
            if self._belief is not None:
                return self._finder.find_again(subject, self._situation(self._belief))
            begun = self._finder.begin(subject, cut.isolated.view.planes, self._start, self._watch)
            self._start, self._belief, self._watch = begun.start, begun.belief, begun.watch
            if begun.belief is not None and self._seeks_size():
                self._size = SizeEstimate()
            return None

    def _mind_company(self, cut: CutOut, belief: Belief, *, first: bool) -> None:
        """Note who else stands there, when the body was found or when something is unexplained."""
        asks = self._minds_company and (first or self._watch.unexplained > 0)
        if asks and has_company(cut.isolated.view, PosedBody(self.model, belief.reported).surface):
            self._watch = self._watch.accompanied()

    def _lose(self, submitted: Submitted) -> Status:
        """Nothing of the body was seen: hypotheses stay where they are."""
        if self._belief is None:
            return "searching" if submitted.shows and self._watch.failures else "absent"
        unseen = np.full(len(self._belief.residual), np.nan)
        self._belief = replace(self._belief.at_rest(), residual=unseen)
        self.saw_nobody()
        return "lost" if submitted.shows else "absent"

    def _believe(self, answer: Answer, subject: SubjectFrame, rival: Finding | None) -> None:
        """Take in what a frame says of the pose, and of the person's size if that pose is believed."""
        situation = self._situation(answer.belief)
        self._belief, watch = decide(situation, rival, self._inference.begin_with)
        self._watch = watch.shown(subject.pixels)
        if self._belief is answer.belief:
            self._measure_size(subject)

    def _seeks_size(self) -> bool:
        """Whether the body comes in sizes, and is free to be placed anew for each."""
        in_sizes = self._settings.measure_person and self._bodies.people and self._bodies.measures is None
        return in_sizes and self._watch is not GIVEN and set(ROOT_DOFS) <= set(self.model.dof_names)

    def _measure_size(self, subject: SubjectFrame) -> None:
        """Measure the person's stature in a frame in which the pose is settled."""
        size, belief, time_s = self._size, self._belief, subject.frame.time_s
        if size is None or belief is None or not size.is_due(time_s):
            return
        poses = belief.poses[:RECORDED]
        if is_settled(self._watch, belief.weights[:RECORDED], joint_positions(self.model, poses)):
            straight = self._straight_share * self._start.stature
            stature = measure_stature(self.model, belief.poses[0], straight, subject)
            if stature is not None:
                self._size = size.add(stature, time_s)

    @cached_property
    def _straight_share(self) -> float:
        """Distance from head to ankle of a person who stands straight, as a share of stature."""
        return head_to_ankle(self._bodies.full(*USUAL_MEASURES)) / USUAL_MEASURES[0]

    def _resize(self) -> None:
        """Go on with a body of the stature that is known by now."""
        start = self._start
        if self._size is None or (stature := self._size.revise(start.stature)) == start.stature:
            return
        model = scaled(start.model, stature / start.stature)
        self._start = replace(start, model=model, stature=stature)

    def _whereabouts(self) -> Array | None:
        """The pose (D,) near which the next frame but one shows the body; None where it may be anywhere.

        That frame is cut out before this one is collected, so it is what is known before this one.
        """
        if self._belief is None or (self._watch.seeks and self._finder.recovers(self._start)):
            return None
        return self._belief.reported

    def _situation(self, belief: Belief) -> Situation:
        """A belief, and all that it is seen with."""
        return Situation(self._start, belief, self._watch, self.rules)
