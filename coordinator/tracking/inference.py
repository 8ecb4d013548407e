"""What a frame says of the body's pose and of the person's size, by particles that the workers refine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.bounds import most_iterations
from common.frame import SubjectFrame
from common.kinematics import natural_angles
from common.refinement import Refined
from common.settings import RefineSettings, Settings
from coordinator.filters.belief import Belief, Proposal
from coordinator.filters.methods import METHODS
from coordinator.tracking.certainty.evidence import Sighted
from coordinator.tracking.observing.known_motion import KnownMotion
from coordinator.tracking.observing.sighting import see
from coordinator.tracking.pace import pace_iterations
from coordinator.tracking.refiner import Pending, Refiner
from coordinator.tracking.search.seeker import Finding
from coordinator.tracking.search.settling import begin_with
from coordinator.tracking.search.watch import Watch
from coordinator.tracking.starting.start import Start
from coordinator.tracking.stopwatch import Stopwatch

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """What is believed of a body at a frame, and how particles are refined on it."""

    start: Start
    belief: Belief
    watch: Watch
    rules: RefineSettings


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    """Particles of a body that are with the workers."""

    model: BodyModel
    rules: RefineSettings
    proposal: Proposal[Any]
    sighted: Sighted  # what they are refined on
    pending: Pending


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What particles say of a frame."""

    belief: Belief
    answered: int  # particles at the least, of those that the belief is from


class Inference:
    """The steps of a method, frame by frame, with the workers' part of them.

    Args:
        refiner: Has particles refined, on the frame that was published last.
        settings: What to compute.
        rng: All that is drawn is drawn from it.
        known: How joints move, as encoders report it.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        rng: np.random.Generator,
        known: KnownMotion | None = None,
    ) -> None:
        self._refiner = refiner
        self._settings = settings
        self._method = METHODS[settings.method]
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
        """Let the workers refine the particles of a frame."""
        rules, past = situation.rules, situation.belief.reported
        stretch, lone = rules.noise_lateral / rules.noise_depth, len(proposal.poses) == 1
        sighted = Sighted(subject, past, proposal.interval, stretch, lone, first)
        pending = self._send(situation.start.model, rules, proposal)
        return Request(situation.start.model, rules, proposal, sighted, pending)

    def answer(self, request: Request, clock: Stopwatch) -> Answer:
        """Wait for the workers, and believe what they found; layers ask them more than once."""
        answered = len(request.proposal.poses)
        while True:
            with clock.stage("refine"):
                refined = request.pending.result()
            with clock.stage("merge"):
                answered = min(answered, len(refined.answered))
                found = self._update(request, refined)
            if not isinstance(found, Proposal):
                from_guess = request.sighted.first  # whose way there is no motion
                return Answer(found.at_rest() if from_guess else found, answered)
            with clock.stage("refine"):
                pending = self._send(request.model, request.rules, found)
                request = replace(request, proposal=found, pending=pending)

    def _send(
        self,
        model: BodyModel,
        rules: RefineSettings,
        proposal: Proposal[Any],
    ) -> Pending:
        poses, settings = proposal.poses, self._settings
        most = most_iterations(poses.shape, settings.points, len(model.vertices))
        paced = pace_iterations(rules, proposal.interval, settings.pace_iterations, most)
        return self._refiner.submit(model, poses, paced, covariance=proposal.asks_covariance(paced))

    def _update(self, request: Request, refined: Refined) -> Belief | Proposal[Any]:
        """The belief after particles were refined, or more particles to refine."""
        refined = replace(refined, poses=natural_angles(request.model, refined.poses))
        return self._method.update(request.model, request.proposal, refined, self._settings.filter, self._rng)
