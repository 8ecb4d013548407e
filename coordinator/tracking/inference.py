"""What a frame says of the body's pose and of the person's size, by particles that the workers refine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.bounds import most_iterations
from common.frame import SubjectFrame
from common.kinematics import joint_positions, natural_angles
from common.refinement import Refined
from common.settings import RefineSettings, Settings
from common.sizes import Body
from coordinator.filters.belief import Belief
from coordinator.filters.methods import METHODS
from coordinator.filters.proposal import Proposal
from coordinator.tracking.certainty.evidence import Sighted
from coordinator.tracking.estimate import RECORDED
from coordinator.tracking.observing.known_motion import KnownMotion
from coordinator.tracking.observing.sighting import see
from coordinator.tracking.pace import pace_iterations
from coordinator.tracking.refiner import Pending, Refiner
from coordinator.tracking.search.seeker import Finding
from coordinator.tracking.search.settling import begin_with
from coordinator.tracking.search.stages import rounds
from coordinator.tracking.search.watch import Watch
from coordinator.tracking.starting.asking import Question
from coordinator.tracking.starting.person_size import PersonSize
from coordinator.tracking.starting.start import Start
from coordinator.tracking.starting.uprightness import ends_of
from coordinator.tracking.status import is_settled
from coordinator.tracking.stopwatch import Stopwatch

Array = NDArray[np.float64]

APART = 3  # iterations for bodies of several sizes, where particles do not descend


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """What is believed of a body at a frame, and how particles are refined on it."""

    start: Start
    belief: Belief
    watch: Watch
    rules: RefineSettings

    @property
    def is_settled(self) -> bool:
        """Whether the hypotheses explain what is seen, and agree of where head and feet are."""
        poses, weights = self.belief.poses[:RECORDED], self.belief.weights[:RECORDED]
        joints = joint_positions(self.start.model, poses)[:, ends_of(self.start.model)]
        return is_settled(self.watch, weights, joints)


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """Particles of a body that are with the workers."""

    model: BodyModel
    rules: RefineSettings
    proposal: Proposal[Any]
    sighted: Sighted  # what they are refined on
    pending: Pending
    question: Question | None = None  # of the person's size, whose particles come last


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What particles say of a frame."""

    belief: Belief
    answered: int  # particles at the least, of those that the belief is from
    question: Question | None  # of the person's size, that was asked beside them
    sizes: Refined  # what was answered to it


class Inference:
    """The steps of a method, frame by frame, with the workers' part of them.

    Args:
        refiner: Has particles refined, on the frame that was published last.
        settings: What to compute.
        size: Of the person, about which some frames are asked.
        rng: All that is drawn is drawn from it.
        known: How joints move, as encoders report it.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        size: PersonSize,
        rng: np.random.Generator,
        known: KnownMotion | None = None,
    ) -> None:
        self._refiner = refiner
        self._settings = settings
        self._method = METHODS[settings.method]
        self._size = size
        self._rng = rng
        self._known = known

    def begin(self, model: BodyModel, pose: Array) -> Belief:
        """The belief in a pose (D,)."""
        return self._method.begin(model, pose, self._settings.filter)

    def begin_with(self, finding: Finding) -> Belief:
        """The belief in what was found."""
        return begin_with(self._method, finding.start.model, finding.standing, self._settings.filter)

    def draw(
        self, model: BodyModel, belief: Belief, subject: SubjectFrame, last_time_s: float | None
    ) -> Proposal[Any]:
        """Particles for the next frame, from a belief that is of this time."""
        step, time_s = None, subject.frame.time_s
        if self._known is not None:
            step = self._known.step(model, belief.reported, last_time_s, time_s)
        sighting = see(subject, last_time_s, step)
        return self._method.propose(model, belief, sighting, self._settings.filter, self._rng)

    def submit(
        self, situation: Situation, proposal: Proposal[Any], subject: SubjectFrame, *, first: bool
    ) -> Request:
        """Let the workers have the particles of a frame, and those by which it is asked about sizes."""
        rules, past = situation.rules, situation.belief.reported
        stretch, lone = rules.noise_lateral / rules.noise_depth, len(proposal.poses) == 1
        sighted = Sighted(subject, past, proposal.interval, stretch, lone, first)
        question = self._ask(situation, proposal.poses[0], subject.frame.time_s) if self._descends else None
        pending = self._send(situation.start.model, rules, proposal, question)
        return Request(situation.start.model, rules, proposal, sighted, pending, question)

    def answer(self, request: Request, clock: Stopwatch) -> Answer:
        """Wait for the workers, and believe what they found; layers ask them more than once."""
        question, answered = request.question, len(request.proposal.poses)
        sizes: Refined | None = None
        while True:
            with clock.stage("refine"):
                refined, beside = request.pending.result().divide(len(request.proposal.poses))
                sizes = sizes or beside
            with clock.stage("merge"):
                answered = min(answered, len(refined.answered))
                found = self._update(request, refined)
            if not isinstance(found, Proposal):
                from_guess = request.sighted.first  # whose way there is no motion
                return Answer(found.at_rest() if from_guess else found, answered, question, sizes)
            with clock.stage("refine"):
                pending = self._send(request.model, request.rules, found)
                request = replace(request, proposal=found, pending=pending)

    def hear(self, situation: Situation, answer: Answer, subject: SubjectFrame) -> None:
        """Take in what a frame says of the person's size, if the pose that it shows is settled."""
        pose = situation.belief.poses[0]
        question, sizes = answer.question, answer.sizes
        if not self._descends:  # the sizes have to
            question = self._ask(situation, pose, subject.frame.time_s)
            if question is not None:
                rules = rounds(situation.rules, APART)
                sizes = self._refiner.submit(question.bodies, question.poses, rules).result()
        if question is not None and situation.is_settled:
            self._size.hear(question, sizes, situation.start, pose, subject)

    @property
    def _descends(self) -> bool:
        """Whether particles are moved by their refinement."""
        return self._settings.refine.icp_iterations > 0

    def _ask(self, situation: Situation, pose: Array, time_s: float) -> Question | None:
        """What to ask about the person's size where a pose (D,) is expected, if the belief is settled."""
        question = self._size.ask(situation.start, pose, time_s, situation.rules)
        return question if question is not None and situation.is_settled else None

    def _send(
        self,
        model: BodyModel,
        rules: RefineSettings,
        proposal: Proposal[Any],
        question: Question | None = None,
    ) -> Pending:
        body: Body = model
        poses, settings = proposal.poses, self._settings
        if question is not None:
            body, poses = question.beside(model, poses)
        most = most_iterations(poses.shape, settings.points, len(model.vertices))
        paced = pace_iterations(rules, proposal.interval, settings.pace_iterations, most)
        return self._refiner.submit(body, poses, paced, covariance=proposal.asks_covariance(paced))

    def _update(self, request: Request, refined: Refined) -> Belief | Proposal[Any]:
        """The belief after particles were refined, or more particles to refine."""
        refined = replace(refined, poses=natural_angles(request.model, refined.poses))
        return self._method.update(request.model, request.proposal, refined, self._settings.filter, self._rng)
