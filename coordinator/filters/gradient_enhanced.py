"""The gradient-enhanced particle filter, steps 1 to 7 of section 4.3, one verb a line.

Where the paper is silent: weights are the likelihoods of the merged hypotheses (it asks for equal weights
within a group, not for their sum); a hypothesis moves on with the velocity that led from its ancestor to
it; a lone particle keeps the covariance of its ancestor; the reported pose is the likeliest hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.kinematics import difference
from common.refinement import Refined
from common.settings import FilterSettings
from coordinator.filters.belief import Belief
from coordinator.filters.covariance import estimate_covariances
from coordinator.filters.exploration import SPREAD, explore, proposal_kinds
from coordinator.filters.merging import merge
from coordinator.filters.motion import draw_noise, propagate
from coordinator.filters.proposal import Proposal
from coordinator.filters.resampling import systematic

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses(Belief):
    """What the filter knows after a frame: merged particles, likeliest first, each with its valley."""

    covariances: Array  # (M, D, D) of relative motion


def begin(model: BodyModel, pose: Array, settings: FilterSettings) -> Hypotheses:
    """Step 1: one hypothesis at the initial pose (D,), its standard deviation the merging distance d."""
    deviation = np.where(
        model.kinds == ROTATION, np.deg2rad(settings.merge_angle_deg), settings.initial_position_deviation
    )
    return Hypotheses(
        poses=pose[None].copy(),
        log_weights=np.zeros(1),
        residual=np.full(1, np.nan),
        velocities=np.zeros((1, len(pose))),
        reported=pose.copy(),
        covariances=np.diag(deviation**2)[None],
    )


def propose(
    model: BodyModel, past: Hypotheses, settings: FilterSettings, rng: np.random.Generator
) -> Proposal[Hypotheses]:
    """Steps 2 and 3: the particles of a frame, whose descent and likelihood are steps 4 and 5."""
    ancestors = draw(past, settings, rng)  # 2
    return Proposal(past, ancestors, scatter(model, past, ancestors, settings, rng))  # 3


def update(
    model: BodyModel,
    proposal: Proposal[Hypotheses],
    after: Refined,
    settings: FilterSettings,
    rng: np.random.Generator,  # noqa: ARG001 as all methods
) -> Hypotheses:
    """Steps 6 and 7: hypotheses from the proposed particles after their descent."""
    past, ancestors, before = proposal.past, proposal.ancestors, proposal.poses
    answered = after.answered
    if len(answered) < len(before):
        ancestors, before, after = ancestors[answered], before[answered], after.take(answered)
    chosen, group = merge(model, after.poses, after.log_likelihood, np.deg2rad(settings.merge_angle_deg))  # 6
    parents = ancestors[chosen]
    covariances = estimate_covariances(  # 7
        model, before, after.poses[chosen], group, past.covariances[parents], settings.covariance_reduction
    )
    return Hypotheses(
        poses=after.poses[chosen],
        log_weights=after.log_likelihood[chosen],
        residual=after.residual[chosen],
        velocities=difference(model, past.poses[parents], after.poses[chosen]),
        reported=after.poses[chosen[0]],
        covariances=covariances,
    )


def draw(past: Hypotheses, settings: FilterSettings, rng: np.random.Generator) -> NDArray[np.int64]:
    """Step 2: ancestors (N,) of the new particles."""
    return systematic(past.weights, settings.particles, rng)


def scatter(
    model: BodyModel,
    past: Hypotheses,
    ancestors: NDArray[np.int64],
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Array:
    """Step 3: particles (N, D), moved by the motion model and spread by their ancestors' covariance."""
    noise = draw_noise(past.covariances, ancestors, rng, keeps_noise(ancestors, settings))
    velocities = settings.velocity_share * past.velocities[ancestors]
    if settings.explore:
        noise, velocities = explore(model, noise, velocities, ancestors, settings, rng)
    return propagate(model, past.poses[ancestors], velocities, noise)


def keeps_noise(ancestors: NDArray[np.int64], settings: FilterSettings) -> NDArray[np.bool_]:
    """Which particles (N,) keep the noise of their ancestor's covariance; a lone one has none."""
    if settings.explore:
        spread: NDArray[np.bool_] = proposal_kinds(ancestors) == SPREAD
        return spread
    return np.full(len(ancestors), settings.particles > 1)
