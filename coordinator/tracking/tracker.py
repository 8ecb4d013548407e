"""One tracker: depth frames in, estimates out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.errors import InputError
from common.frame import DepthFrame, SubjectFrame
from common.kinematics import bounding_box, joint_positions, natural_angles
from common.refinement import Refined
from common.settings import RefineSettings, Settings
from coordinator.bodies.tracked import Bodies
from coordinator.filters.belief import Belief
from coordinator.filters.methods import METHODS
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.look_ahead import Lookahead
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.sensor_noise import SensorNoise, measure_noise, told
from coordinator.tracking.start import Start, find_start, given_start, require_start
from coordinator.tracking.state import TrackerState, load_generator, take_checkpoint
from coordinator.tracking.status import judge
from coordinator.tracking.subject import CLEARANCE, isolate

Array = NDArray[np.float64]

RECORDED = 100  # hypotheses of a frame at the most, the likeliest


class Tracker:
    """Follows one body through a sequence.

    Args:
        refiner: Has particles refined, here or elsewhere.
        settings: What to compute.
        bodies: Gives the body that is tracked, by its measures.
        start: Values of degrees of freedom in the first frame, metres and radians; None to find
            them, which can be done for people only.
        state: Go on from here, where another tracker of the same settings left off.
    """

    def __init__(
        self,
        refiner: Refiner,
        settings: Settings,
        bodies: Bodies,
        start: Mapping[str, float] | None = None,
        state: TrackerState | None = None,
    ) -> None:
        require_start(start, bodies)
        self._refiner = refiner
        self._settings = settings
        self._method = METHODS[settings.method]
        self._bodies = bodies
        self._given = start
        self._rng = np.random.default_rng(settings.seed)
        self._start: Start | None = None
        self._belief: Belief | None = None
        self._around: Array | None = None  # pose (D,) near which the next frame shows the subject
        self._ahead: tuple[DepthFrame, SubjectFrame | None] | None = None  # cut out before its turn
        if state is not None:
            self._around = state.checkpoint.around
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
        return TrackerState(self.start, take_checkpoint(self._belief, self._around, self._rng))

    def follow(self, frames: Iterable[DepthFrame], take: Callable[[Estimate, TrackerState], None]) -> None:
        """Track frames in their order, the same as `track` does one by one.

        While the workers are busy with a frame, `take` is given the estimate of the one before and all that
        was known after it; and the next is read and sent to the workers.
        """
        coming = Lookahead(frames)
        last: Finished | None = None

        def tell() -> None:
            nonlocal last
            if last is not None:
                told, last = last, None
                take(self._report(told), told.state)

        def meanwhile(clock: Stopwatch) -> None:
            tell()
            clock.lap("report")
            self._send_ahead(coming.peek(), clock)

        try:
            for frame in coming:
                now = self._advance(frame, meanwhile)
                tell()
                last = now
        finally:
            tell()

    def track(self, frame: DepthFrame) -> Estimate:
        """Follow the body into the next frame. InputError if nothing is seen in the first."""
        return self._report(self._advance(frame, lambda _: None))

    def _advance(self, frame: DepthFrame, meanwhile: Callable[[Stopwatch], None]) -> Finished:
        """Track one frame; `meanwhile` is called while the workers are busy, if there is work for them."""
        clock = Stopwatch()
        subject = self._isolate(frame, clock)
        if subject is None:
            return self._carry_on(frame, clock)
        self._refiner.publish(subject)
        clock.lap("publish")
        guessed = self._belief is None
        past = self._begin(subject) if self._belief is None else self._belief
        self._around = past.reported
        clock.lap("start")
        answered = self._settings.filter.particles

        def while_refining() -> None:
            clock.lap("refine")
            meanwhile(clock)

        def refine(poses: Array) -> Refined:
            nonlocal answered
            clock.lap("draw")
            refined = self._refiner.refine(self.model, poses, self.rules, while_refining)
            clock.lap("refine")
            answered = min(answered, len(refined.answered))
            return replace(refined, poses=natural_angles(self.model, refined.poses))

        found = self._method.advance(self.model, past, refine, self._settings.filter, self._rng)
        self._belief = found.at_rest() if guessed else found  # the way from a guess is no motion
        clock.lap("merge")
        return Finished(frame, self.state, self._belief, clock.laps, answered)

    def _isolate(self, frame: DepthFrame, clock: Stopwatch) -> SubjectFrame | None:
        """What is near the body as it was two frames ago: so it can be cut out while the last is refined."""
        if self._ahead is not None and self._ahead[0] is frame:
            return self._ahead[1]
        subject = isolate(frame, self._surroundings(), self._settings.points)
        clock.lap("isolate")
        return subject

    def _send_ahead(self, frame: DepthFrame | None, clock: Stopwatch) -> None:
        """Cut out the next frame, and let the workers have it; once, however often it is asked for."""
        if frame is None or (self._ahead is not None and self._ahead[0] is frame):
            return
        subject = self._isolate(frame, clock)
        self._ahead = frame, subject
        if subject is not None:
            self._refiner.send_ahead(subject)
            clock.lap("publish")

    def _surroundings(self) -> Array | None:
        """Box (2, 3) around which a frame is cut out, at first of the given pose; None for all of it."""
        if self._around is not None:
            return bounding_box(self.model, self._around)
        if self._given is not None:
            start = given_start(self._given, self._bodies)
            return bounding_box(start.model, start.pose)
        return None

    @property
    def rules(self) -> RefineSettings:
        """How particles are refined: the settings, for the noise that was found at the start."""
        return told(self._settings.refine, self.start.noise)

    def _begin(self, subject: SubjectFrame) -> Belief:
        noise = measure_noise(subject.frame) if self._settings.measure_noise else SensorNoise()
        if self._given is not None:
            start = given_start(self._given, self._bodies)
        else:
            start = find_start(subject, self._bodies, self._refiner, told(self._settings.refine, noise))
        self._start = replace(start, noise=noise)
        return self._begin_at(self._start)

    def _begin_at(self, start: Start) -> Belief:
        return self._method.begin(start.model, start.pose, self._settings.filter)

    def _carry_on(self, frame: DepthFrame, clock: Stopwatch) -> Finished:
        """Nothing was seen: hypotheses stay where they are, the frame is lost."""
        if self._belief is None:
            where = "" if self._given is None else f" within {100 * CLEARANCE:.0f} cm of the given start"
            raise InputError(
                f"frame {frame.number} shows no depth{where}, so there is nothing to start from; "
                "begin with a frame that shows the person, e.g. with --frames"
            )
        self._around = self._belief.reported
        unseen = np.full(len(self._belief.residual), np.nan)
        self._belief = replace(self._belief.at_rest(), residual=unseen)
        return Finished(frame, self.state, self._belief, clock.laps, answered=0)

    def _report(self, done: Finished) -> Estimate:
        """What is said about a frame."""
        found, weights = done.belief, done.belief.weights
        shown = found.poses[:RECORDED]
        joints = joint_positions(self.model, np.concatenate([found.reported[None], shown]))
        residual = float(found.residual[0])
        return Estimate(
            frame=done.frame.number,
            time_s=done.frame.time_s,
            status=judge(residual, self.rules.noise_depth, weights[:RECORDED], joints[1:]),
            pose=found.reported,
            joint_positions=joints[0],
            hypothesis_pose=shown,
            hypothesis_weight=weights[:RECORDED] / weights[:RECORDED].sum(),
            residual=residual,
            particles_answered=done.answered,
            stage_seconds=done.laps,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Finished:
    """A frame that was tracked, of which nothing was said yet."""

    frame: DepthFrame
    state: TrackerState  # after it
    belief: Belief  # the same as in the state
    laps: dict[str, float]  # seconds by stage
    answered: int  # particles


class Stopwatch:
    """Seconds by stage of one frame."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Add the time since the last lap to a stage."""
        now = time.perf_counter()
        self.laps[stage] = self.laps.get(stage, 0.0) + now - self._last
        self._last = now
