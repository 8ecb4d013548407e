"""The particles of one body: drawn from its belief, sent to the workers, and merged once they are refined."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Union

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, BodyModel
from gepf.common.bounds import MAX_ITERATIONS
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import difference, joint_positions, natural_angles
from gepf.common.refinement import Particles
from gepf.common.settings import RefineSettings
from gepf.coordinator.bodies.family import BodyFamily
from gepf.coordinator.filters.belief import USUAL_INTERVAL, Belief, Proposal
from gepf.coordinator.filters.methods import METHODS, initial_belief
from gepf.coordinator.filters.priors import frame_share, pose_prior, updated_precision
from gepf.coordinator.settings import Settings
from gepf.coordinator.sources.joint_states import JointStates
from gepf.coordinator.tracking.certainty import FrameContext
from gepf.coordinator.tracking.observation import filter_observation, in_view, unseen_dofs
from gepf.coordinator.tracking.pose_candidates import Detection, PoseCandidates
from gepf.coordinator.tracking.refiner import Refiner, Request, with_iterations
from gepf.coordinator.tracking.reporting import Stopwatch
from gepf.coordinator.tracking.segmenter import BodyView

if TYPE_CHECKING:  # importing this module loads ROS 2
    from gepf.coordinator.sources.ros2_input import JointTopic

Encoders = Union[JointStates, "JointTopic"]
"""Values of joints over time."""


@dataclass(frozen=True, slots=True)
class FrameBudget:
    """What a live frame has time for."""

    period_s: float  # between published frames
    is_late: bool  # whether it had to wait, or a newer one is already waiting


@dataclass(frozen=True, slots=True, eq=False)
class SubmittedPerson:
    """A person in a frame, whose particles are with the workers."""

    view: BodyView
    settings: RefineSettings  # to refine the particles; if merged early, to refine their representatives
    particle_count: int
    proposal: Proposal
    pending: Request
    context: FrameContext
    detection: Detection | None  # result of a search for the body, if any
    clock: Stopwatch


class ParticleFilter:
    """Steps 2 to 7 of Grest and Krueger (2007) for one body, with the method that the settings select."""

    def __init__(
        self, refiner: Refiner, settings: Settings, family: BodyFamily, motion: Encoders | None
    ) -> None:
        self._refiner, self._settings, self._family, self._motion = refiner, settings, family, motion
        self._method = METHODS[settings.method]
        self.rng = np.random.default_rng(settings.seed)

    def belief_from(self, model: BodyModel, candidates: PoseCandidates) -> Belief:
        """The belief from all candidates if the method has several hypotheses, else from the best."""
        belief = initial_belief(model, candidates.poses[0], self._settings)
        if not len(belief.covariances) or self._settings.filter.particles == 1:
            return replace(belief, log_weights=candidates.log_posterior[:1], residual=candidates.residual[:1])
        return replace(
            belief,
            poses=candidates.poses,
            log_weights=candidates.log_posterior,
            residual=candidates.residual,
            velocities=np.zeros_like(candidates.poses),
            covariances=np.repeat(belief.covariances, len(candidates.poses), axis=0),
        )

    def propose(
        self,
        model: BodyModel,
        belief: Belief,
        subject: SubjectFrame,
        time_s: float | None,
        budget: FrameBudget | None,
        motion_m: Array | None = None,
    ) -> Proposal:
        """Particles for a frame; fewer if it is late, unless the method needs all of them.

        `time_s` is the time of the last frame that showed the body, `motion_m` (3,) the motion of the whole
        body since then, if it is known.
        """
        step = None if motion_m is None else root_step(model, motion_m)
        if self._motion is not None:
            measured = encoder_step(self._motion, model, belief.reported, time_s, subject.time_s)
            step = step if measured is None else measured
        seen, unseen = in_view(subject, joint_positions(model, belief.reported[None])[0]), None
        if not seen.all():
            unseen = unseen_dofs(model, seen)
        observation = filter_observation(subject, time_s, step, unseen)
        settings = self._settings.filter
        if budget is not None and budget.is_late and self._method.descends:
            late_particles = min(settings.particles, settings.exploration.late_particles)
            settings = msgspec.structs.replace(settings, particles=late_particles)
        return self._method.propose(model, belief, observation, settings, self.rng)

    def scale_iterations(
        self, settings: RefineSettings, interval: float, budget: FrameBudget | None
    ) -> RefineSettings:
        """Settings with the iterations for this interval between frames, seconds."""
        interval = interval if budget is None else min(interval, budget.period_s)
        return pace_iterations(settings, interval, self._settings)

    def early_settings(self, settings: RefineSettings, budget: FrameBudget | None) -> RefineSettings | None:
        """Settings for the first iterations of particles that are merged early, made from those for all.

        None if particles are merged only once: if there are no more iterations than usual, so that a second
        request would not pay off; if the frame is late, and so has few particles; or if correspondences are
        soft.
        """
        iterations = settings.icp_iterations
        early = round(self._settings.filter.early_share * iterations)
        is_late = budget is not None and budget.is_late
        is_usual = iterations <= self._settings.refine.icp_iterations
        if is_usual or is_late or settings.is_soft or not 0 < early < iterations:
            return None
        return with_iterations(settings, early)

    def send_first(
        self,
        model: BodyModel,
        subject: SubjectFrame,
        proposal: Proposal,
        settings: RefineSettings,
        budget: FrameBudget | None,
    ) -> tuple[Proposal, Request]:
        """Send the particles of a frame to the workers, for fewer iterations if they are merged early."""
        early = None if proposal.expected is None else self.early_settings(settings, budget)
        proposal = replace(proposal, merges_early=early is not None)
        return proposal, self.send(model, subject, proposal, early or settings)

    def send(
        self, model: BodyModel, subject: SubjectFrame, proposal: Proposal, settings: RefineSettings
    ) -> Request:
        """Send particles to the workers."""
        covariance, velocity = proposal.asks_covariance(settings), proposal.past.velocity
        error_time_s = self._settings.shape.error_time_s
        past, share = proposal.past, frame_share(proposal.interval, error_time_s)
        prior = pose_prior(model, settings, past.reported, past.shape_precision / share)
        particles = Particles(proposal.poses, settings, covariance, velocity=velocity, prior=prior)
        return self._refiner.submit(subject, model, particles)

    def continue_refinement(self, model: BodyModel, submitted: SubmittedPerson) -> SubmittedPerson:
        """If particles are merged early, wait for their first iterations, and send the representatives."""
        if not submitted.proposal.merges_early:
            return submitted
        representatives = self._merge(model, submitted)
        assert isinstance(representatives, Proposal)
        return self._send_next(model, submitted, representatives)

    def update(self, model: BodyModel, submitted: SubmittedPerson) -> Belief:
        """The belief after refinement; `annealed` refines several layers."""
        after = self._merge(model, submitted)
        while isinstance(after, Proposal):
            submitted = self._send_next(model, submitted, after)
            after = self._merge(model, submitted)
        precision, count = submitted.proposal.past.shape_precision, model.shape_count
        if count and len(after.posterior):
            covariance = after.posterior[:count, :count]
            interval = submitted.proposal.interval
            precision = updated_precision(precision, covariance, interval, self._settings.shape)
        after = replace(after, shape_precision=precision)
        from_guess = submitted.context.past_is_guess  # the change since a guess is not motion
        return after.at_rest() if from_guess else after

    def _send_next(self, model: BodyModel, submitted: SubmittedPerson, proposal: Proposal) -> SubmittedPerson:
        """Send the next particles of a frame."""
        with submitted.clock.stage("refine"):
            pending = self.send(model, submitted.context.subject, proposal, submitted.settings)
        return replace(submitted, proposal=proposal, pending=pending)

    def _merge(self, model: BodyModel, submitted: SubmittedPerson) -> Belief | Proposal:
        """Wait for the refined particles; return the belief after them, or the next particles to refine."""
        with submitted.clock.stage("refine"):
            refined = submitted.pending.result()
        with submitted.clock.stage("merge"):
            poses = natural_angles(model, refined.poses)
            log_prior = partial(self._family.log_pose_prior, model, submitted.settings)
            log_posterior = refined.log_likelihood + log_prior(poses)
            refined = replace(refined, poses=poses, log_likelihood=log_posterior)  # the weight
            proposal = replace(submitted.proposal, log_prior=log_prior)
            return self._method.update(model, proposal, refined, self._settings.filter, self.rng)


def pace_iterations(refine: RefineSettings, interval: float, settings: Settings) -> RefineSettings:
    """Scale the iterations of ICP with the interval in seconds.

    The factor is 1 + pace (interval / usual interval - 1), at most max_pace^pace: 5 at 0.1 s and pace 2. The
    result is at most MAX_ITERATIONS, unless the settings have more.
    """
    pace = settings.pace_iterations
    factor = 1.0 + pace * max(interval / USUAL_INTERVAL - 1.0, 0.0)
    usual = refine.icp_iterations
    paced = min(round(usual * min(factor, settings.max_pace**pace)), MAX_ITERATIONS)
    return msgspec.structs.replace(refine, icp_iterations=max(usual, paced))


def root_step(model: BodyModel, motion_m: Array) -> Array:
    """The motion (D,) of a body whose root moves by `motion_m` (3,), metres; NaN for unknown parts."""
    step = np.full(len(model.dof_names), np.nan)
    for name, metres in zip(ROOT_DOFS[:3], motion_m, strict=True):
        if name in model.dof_names:
            step[model.dof(name)] = metres
    return step


def encoder_step(
    encoders: Encoders, model: BodyModel, pose: Array, since_s: float | None, until_s: float
) -> Array | None:
    """The motion (D,) between two times according to encoders, NaN if unknown; None if all of it is unknown.

    Only changes are used, so offsets of encoders do not matter. `pose` (D,) gives missing angles of a
    spherical joint. Its motion is known only if all its angles are.
    """
    if since_s is None:
        return None
    before, after = pose.copy(), pose.copy()
    measured = np.zeros(len(pose), dtype=bool)
    first, last = encoders.at(since_s), encoders.at(until_s)
    # a topic has no names before its first message
    for name, start, end in zip(encoders.names, first, last, strict=False):
        if name in model.dof_names and np.isfinite(start + end):
            j = model.dof(name)
            before[j], after[j], measured[j] = start, end, True
    for ball in model.balls:
        measured[ball : ball + 3] = measured[ball : ball + 3].all()
    step = difference(model, before[None], after[None])[0]
    return np.where(measured, step, np.nan) if measured.any() else None
