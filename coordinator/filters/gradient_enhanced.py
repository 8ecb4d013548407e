"""The gradient-enhanced particle filter, steps 1 to 7 of section 4.3, one verb a line.

Where the paper is silent: weights are the likelihoods of the merged hypotheses (it asks for equal weights
within a group, not for their sum); a hypothesis moves on with the velocity that led from its ancestor to
it; a lone particle keeps the covariance of its ancestor; what a frame does not show stays where motion
leads it (preset `default`, see `holding`); the reported pose is the hypothesis that is likeliest given the
frame and the motion from the last one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.kinematics import difference, retract
from common.refinement import Refined
from common.settings import FilterSettings
from coordinator.filters.belief import Belief, likeliest_way_on
from coordinator.filters.covariance import estimate_covariances, found_by_descent, shrink
from coordinator.filters.exploration import (
    HIDING,
    ONE_LIMB,
    REACHING,
    RESTING,
    SPREAD,
    choose_kinds,
    perturb,
)
from coordinator.filters.holding import hold
from coordinator.filters.limbs.hiding import find_hidden
from coordinator.filters.limbs.layout import view_limbs
from coordinator.filters.limbs.reaching import find_reaches
from coordinator.filters.mahalanobis import merge_by_mahalanobis
from coordinator.filters.merging import merge
from coordinator.filters.motion import draw_noise, propagate
from coordinator.filters.proposal import Proposal
from coordinator.filters.resampling import systematic
from coordinator.filters.sighting import Sighting

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

REDUCTION = 0.1  # share by which step 7 shrinks every covariance each frame
FIRST_POSITION_DEVIATION = 0.02  # metres, of where a joint that slides begins


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses(Belief):
    """What the filter knows after a frame: merged particles, likeliest first, each with its valley."""

    covariances: Array  # (M, D, D) of relative motion


def begin(model: BodyModel, pose: Array, settings: FilterSettings) -> Hypotheses:
    """Step 1: one hypothesis at the initial pose (D,), its standard deviation the merging distance d."""
    deviation = np.where(
        model.kinds == ROTATION, np.deg2rad(settings.merge_angle_deg), FIRST_POSITION_DEVIATION
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
    model: BodyModel,
    past: Hypotheses,
    sighting: Sighting,
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Proposal[Hypotheses]:
    """Steps 2 and 3: the particles of a frame, whose descent and likelihood are steps 4 and 5."""
    ancestors = draw(past, settings, rng)  # 2
    if settings.explore and settings.particles > 1:
        ancestors[0] = place_of_reported(past)
        return explore(model, past, ancestors, sighting, settings, rng)  # 3
    particles = scatter(model, past, ancestors, sighting, settings, rng)  # 3
    return Proposal(past, ancestors, particles, sighting.interval)


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
    roots = after.covariance_roots
    if roots is None:
        angle = np.deg2rad(settings.merge_angle_deg)
        chosen, group = merge(model, after.poses, after.log_likelihood, angle)  # 6
    else:
        chosen, group = merge_by_mahalanobis(model, after.poses, after.log_likelihood, roots)
    parents = ancestors[chosen]
    poses, log_likelihood = after.poses[chosen], after.log_likelihood[chosen]
    covariances = estimate_covariances(  # 7
        model, before, poses, group, past.covariances[parents], REDUCTION
    )
    origins = past.poses[parents] if proposal.origins is None else proposal.origins[answered[chosen]]
    if roots is not None:
        found = found_by_descent(roots[chosen], poses.shape[1])
        covariances = shrink(covariances, found, group)
        if proposal.expected is not None:
            expected = proposal.expected[answered[chosen]]
            poses = hold(model, poses, found, expected, proposal.interval)
    return Hypotheses(
        poses=poses,
        log_weights=log_likelihood,
        residual=after.residual[chosen],
        velocities=difference(model, origins, poses) / proposal.interval,
        reported=likeliest_way_on(model, past.reported, poses, log_likelihood, proposal.interval),
        covariances=covariances,
    )


def draw(past: Hypotheses, settings: FilterSettings, rng: np.random.Generator) -> NDArray[np.int64]:
    """Step 2: ancestors (N,) of the new particles."""
    return systematic(past.weights, settings.particles, rng)


def place_of_reported(past: Hypotheses) -> int:
    """Which of the hypotheses is the one that was reported."""
    return int(np.argmin(np.abs(past.poses - past.reported).sum(axis=1)))


def scatter(
    model: BodyModel,
    past: Hypotheses,
    ancestors: NDArray[np.int64],
    sighting: Sighting,
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Array:
    """Step 3: particles (N, D), moved by the motion model and spread by their ancestors' covariance.

    A lone particle has no noise.
    """
    noisy = np.full(len(ancestors), settings.particles > 1)
    noise = draw_noise(past.covariances, ancestors, rng, noisy)
    motion = sighting.expect(past.velocities, settings.velocity_share)
    return propagate(model, past.poses[ancestors], motion[ancestors], noise)


def explore(
    model: BodyModel,
    past: Hypotheses,
    ancestors: NDArray[np.int64],
    sighting: Sighting,
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Proposal[Hypotheses]:
    """Step 3 of preset `default`: particles of several kinds, see `exploration`."""
    kinds = choose_kinds(len(ancestors), rng)
    motion = sighting.expect(past.velocities, settings.velocity_share)
    at_rest = sighting.expect(past.velocities, 0.0)
    likeliest = propagate(model, past.poses[:1], motion[:1], np.zeros_like(motion[:1]))[0]
    reaching, thrown = (np.flatnonzero(kinds == kind) for kind in (REACHING, ONE_LIMB))
    view = view_limbs(model, likeliest, sighting.points)
    reaches = find_reaches(view, likeliest, len(reaching), rng)
    hidden = find_hidden(model, likeliest, view, sighting.known, len(thrown), rng)
    kinds[reaching] = SPREAD if reaches is None else REACHING
    kinds[thrown] = ONE_LIMB if hidden is None else HIDING
    noise = draw_noise(past.covariances, ancestors, rng, kinds == SPREAD)
    noise = perturb(model, kinds, noise, rng)
    moving = np.where((kinds == RESTING)[:, None], at_rest[ancestors], motion[ancestors])
    origins = past.poses[ancestors]
    if hidden is not None:
        set_limbs(origins, thrown, hidden.dofs, hidden.angles)
        set_limbs(moving, thrown, hidden.dofs, [np.zeros(len(dofs)) for dofs in hidden.dofs])
    expected = propagate(model, origins, moving, np.zeros_like(noise))
    particles = retract(model, expected, noise)
    if reaches is not None:
        set_limbs(particles, reaching, reaches.dofs, reaches.angles)
    return Proposal(
        past, ancestors, particles, sighting.interval, covariance=True, origins=origins, expected=expected
    )


def set_limbs(poses: Array, which: Indices, dofs: list[Indices], values: list[Array]) -> None:
    """Set limbs of poses (N, D) in place: of some of them, one limb each."""
    for n, limb, value in zip(which, dofs, values, strict=True):
        poses[n, limb] = value
