"""One tracker: depth frames in, estimates out.

A frame's way: `submit` cuts it out, publishes it, draws particles and sends them to the workers; `collect`
waits for them and updates the belief; `report` says what was found. `track` does all three.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.errors import InputError
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import joint_positions, natural_angles
from common.settings import RefineSettings, Settings
from coordinator.bodies.tracked import Bodies
from coordinator.filters.belief import Belief
from coordinator.filters.methods import METHODS, apply_method
from coordinator.filters.proposal import Proposal
from coordinator.scene.scene import SceneChange
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.isolation import Isolation, PosedBody
from coordinator.tracking.pace import pace_iterations
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.sensor_noise import SensorNoise, assume_noise, measure_noise
from coordinator.tracking.sighting import see
from coordinator.tracking.start import Start, find_start, given_start, require_start
from coordinator.tracking.state import TrackerState, load_generator, take_checkpoint
from coordinator.tracking.status import judge
from coordinator.tracking.step import CutOut, Request, Submitted, Tracked
from coordinator.tracking.stopwatch import Stopwatch
from coordinator.tracking.subject import CLEARANCE

Array = NDArray[np.float64]

RECORDED = 100  # hypotheses of a frame at the most, the likeliest


class Tracker:
    """Follows one body through a sequence.

    Args:
        refiner: Has particles refined, here or elsewhere.
        settings: What to compute. What makes their method holds whatever else they say.
        bodies: Gives the body that is tracked, by its measures.
        start: Values of degrees of freedom in the first frame, metres and radians; None to find
            them, which can be done for people only.
        state: Go on from here, where another tracker of the same settings left off.
        isolation: Cuts the body out of the frames; None for the usual way.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        start: Mapping[str, float] | None = None,
        state: TrackerState | None = None,
        isolation: Isolation | None = None,
    ) -> None:
        require_start(start, bodies)
        self._refiner = refiner
        self._settings = settings = apply_method(settings)
        self._method = METHODS[settings.method]
        self._bodies = bodies
        self._given = start
        self._rng = np.random.default_rng(settings.seed)
        self._start: Start | None = None
        self._belief: Belief | None = None
        self._around: Array | None = None  # pose (D,) near which the next frame shows the subject
        self._time_s: float | None = None  # of the last frame that showed something
        self._ahead: CutOut | None = None  # the next frame, cut out before its turn
        self._isolation = isolation or Isolation(settings.points)
        self._scene = SceneChange()  # what the frame that was submitted last changed in it
        if state is not None:
            self._scene = state.checkpoint.scene
            self._isolation.recall(self._scene)
            self._around = state.checkpoint.around
            self._time_s = state.checkpoint.time_s
            self._rng = load_generator(state.checkpoint.generator)
            self._start = state.start
            self._belief = replace(self._begin_at(state.start), **state.checkpoint.belief)

    @property
    def start(self) -> Start:
        """The body and pose that tracking began with; there after the first frame."""
        if self._start is None:
            raise RuntimeError("tracking has not begun: no frame was given yet")
        return self._start

    @property
    def model(self) -> BodyModel:
        """The body that is tracked; there after the first frame."""
        return self.start.model

    @property
    def state(self) -> TrackerState:
        """All that the next frame goes on from; there after the first frame."""
        assert self._belief is not None
        assert self._around is not None
        assert self._time_s is not None
        checkpoint = take_checkpoint(self._belief, self._around, self._time_s, self._rng, self._scene)
        return TrackerState(self.start, checkpoint)

    @property
    def rules(self) -> RefineSettings:
        """How particles are refined: the settings, for the noise that was found at the start."""
        return assume_noise(self._settings.refine, self.start.noise)

    def track(self, frame: DepthFrame) -> Estimate:
        """Follow the body into the next frame. InputError if nothing is seen in the first."""
        return self.report(self.collect(self.submit(frame)))

    def submit(self, frame: DepthFrame) -> Submitted:
        """Draw particles for the next frame and let the workers refine them; `collect` has to follow."""
        cut, self._ahead = self._cut_out(frame), None
        first, clock, subject = self._belief is None, cut.clock, cut.isolated.subject
        self._scene = cut.isolated.change
        if subject is None:
            self._around = self._require_belief(frame).reported
            return Submitted(frame, None, first, clock)
        with clock.stage("publish"):
            self._refiner.publish(subject)
        with clock.stage("start"):
            past = self._begin(subject) if self._belief is None else self._belief
            self._around = past.reported
        with clock.stage("draw"):
            sighting = see(subject, self._time_s)
            proposal = self._method.propose(self.model, past, sighting, self._settings.filter, self._rng)
        with clock.stage("refine"):
            return Submitted(frame, self._request(proposal), first, clock)

    def send_ahead(self, frame: DepthFrame | None) -> None:
        """Cut out the frame that comes next, and let the workers have it before its turn."""
        if frame is None:
            return
        self._ahead = self._cut_out(frame)
        subject = self._ahead.isolated.subject
        if subject is not None:
            with self._ahead.clock.stage("publish"):
                self._refiner.send_ahead(subject)

    def collect(self, submitted: Submitted) -> Tracked:
        """Wait for the refined particles of the frame that was submitted last, and update the belief."""
        if submitted.request is None:
            belief, answered = self._lose(), 0
        else:
            belief, answered = self._update(submitted.request, submitted.clock)
            self._time_s = submitted.frame.time_s
        if submitted.first:
            belief = belief.at_rest()  # the way from a guess is no motion
        self._belief = belief
        return Tracked(submitted.frame, self.state, belief, answered, submitted.clock)

    def report(self, tracked: Tracked) -> Estimate:
        """What was found in a frame that was collected; at any time after that."""
        with tracked.clock.stage("report"):
            found, weights = tracked.belief, tracked.belief.weights[:RECORDED]
            shown = found.poses[:RECORDED]
            joints = joint_positions(self.model, np.concatenate([found.reported[None], shown]))
            residual = float(found.residual[0])
            status = judge(residual, self.rules.noise_depth, weights, joints[1:])
        return Estimate(
            frame=tracked.frame.number,
            time_s=tracked.frame.time_s,
            status=status,
            pose=found.reported,
            joint_positions=joints[0],
            hypothesis_pose=shown,
            hypothesis_weight=weights / weights.sum(),
            residual=residual,
            particles_answered=tracked.answered,
            stage_seconds=tracked.clock.seconds,
        )

    def _request(self, proposal: Proposal[Any]) -> Request:
        refine = self.rules
        if self._settings.pace_iterations:
            refine = pace_iterations(refine, proposal.interval)
        return Request(proposal, self._refiner.submit(self.model, proposal.poses, refine))

    def _update(self, request: Request, clock: Stopwatch) -> tuple[Belief, int]:
        """The belief after a frame, and of how many particles at the least; layers ask for more than once."""
        answered = len(request.proposal.poses)
        while True:
            with clock.stage("refine"):
                refined = request.pending.result()
            with clock.stage("merge"):
                answered = min(answered, len(refined.answered))
                refined = replace(refined, poses=natural_angles(self.model, refined.poses))
                found = self._method.update(
                    self.model, request.proposal, refined, self._settings.filter, self._rng
                )
            if not isinstance(found, Proposal):
                return found, answered
            with clock.stage("refine"):
                request = self._request(found)

    def _lose(self) -> Belief:
        """Nothing was seen: hypotheses stay where they are."""
        assert self._belief is not None
        return replace(self._belief.at_rest(), residual=np.full(len(self._belief.residual), np.nan))

    def _require_belief(self, frame: DepthFrame) -> Belief:
        """The belief before a frame that shows nothing; InputError if it is the first."""
        if self._belief is None:
            where = "" if self._given is None else f" within {100 * CLEARANCE:.0f} cm of the given start"
            raise InputError(
                f"frame {frame.number} shows no depth{where}, so there is nothing to start from; "
                "begin with a frame that shows the person, e.g. with --frames"
            )
        return self._belief

    def _cut_out(self, frame: DepthFrame) -> CutOut:
        """What is near the body as it was two frames ago: so it can be cut out while the last is refined."""
        if self._ahead is not None and self._ahead.frame is frame:
            return self._ahead
        clock = Stopwatch()
        with clock.stage("isolate"):
            return CutOut(frame, self._isolation.cut(frame, self._body()), clock)

    def _body(self) -> PosedBody | None:
        """Near what a frame is cut out, at first the given pose; None where nothing is known yet."""
        if self._around is not None:
            return PosedBody(self.model, self._around)
        if self._given is not None:
            start = given_start(self._given, self._bodies)
            return PosedBody(start.model, start.pose)
        return None

    def _begin(self, subject: SubjectFrame) -> Belief:
        noise = measure_noise(subject.frame) if self._settings.measure_noise else SensorNoise()
        if self._given is not None:
            start = given_start(self._given, self._bodies)
        else:
            refine = assume_noise(self._settings.refine, noise)
            start = find_start(subject, self._bodies, self._refiner, refine)
        self._start = replace(start, noise=noise)
        return self._begin_at(self._start)

    def _begin_at(self, start: Start) -> Belief:
        return self._method.begin(start.model, start.pose, self._settings.filter)
