"""The gradient-enhanced particle filter, steps 1 to 7 of section 4.3.

Decisions that the paper leaves open:
- The weight of a hypothesis is the likelihood of its most likely particle.
- The velocity of a hypothesis is that of the motion model after the step from its ancestor.
- A group of one particle keeps the covariance of its ancestor.
- Occluded limbs follow the motion model (preset `default`, see `priors.fuse_with_prediction`).
- The reported pose is the most likely hypothesis, given the frame and the motion since the last one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import ROTATION, BodyModel
from gepf.common.kinematics import difference, retract
from gepf.common.refinement import Refined, lower_triangular
from gepf.coordinator.filters.belief import (
    Belief,
    Observation,
    Proposal,
    choose_reported,
    draw_ancestors,
    nearest_pose,
    normalise,
)
from gepf.coordinator.filters.exploration import choose_count, choose_kinds, explain, propose_limbs
from gepf.coordinator.filters.priors import draw_noise, fuse_with_prediction, motion_model
from gepf.coordinator.settings import FilterSettings


@dataclass(frozen=True, slots=True, eq=False)
class MergedEarly(Proposal):
    """The representatives of a frame's particles after the first iterations, to be refined further."""

    drawn: Array  # (P, D) the particles that they represent, before any refinement
    group: Indices  # (P,) for each of these, the index of its representative


def begin(model: BodyModel, pose: Array, settings: FilterSettings) -> Belief:
    """Step 1: one hypothesis at the initial pose (D,) with the merging distance d as standard deviation."""
    deviation = np.where(
        model.kinds == ROTATION, np.deg2rad(settings.merge_angle_deg), settings.first_deviation_m
    )
    return Belief.at(pose, covariances=np.diag(model.moves * deviation**2)[None])


def propose(
    model: BodyModel,
    past: Belief,
    observation: Observation,
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Proposal:
    """Steps 2 and 3: the particles of a frame; steps 4 and 5 refine and weight them."""
    if settings.explore and settings.particles > 1:
        return explore(model, past, observation, settings, rng)
    ancestors = draw_ancestors(past.weights, settings.particles, rng)  # 2
    motion = observation.expect(motion_model(settings).predict(past, observation.interval))
    particles = retract(model, past.poses[ancestors], motion[ancestors])  # 3
    if settings.particles > 1:  # a single particle has no noise
        particles = retract(model, particles, draw_noise(past.covariances, ancestors, rng))
    return Proposal(past, ancestors, particles, observation.interval)


def update(
    model: BodyModel,
    proposal: Proposal,
    after: Refined,
    settings: FilterSettings,
    rng: np.random.Generator,  # noqa: ARG001 as all methods
) -> Belief | MergedEarly:
    """Steps 6 and 7: hypotheses from the refined particles, or representatives to be refined further."""
    chosen, group = merge_refined(model, after, settings)  # 6
    if proposal.merges_early:
        return merge_early(proposal, after, chosen, group, settings.min_early_weight)
    past, before, posteriors = proposal.past, proposal.poses, np.empty((0, 0, 0))
    if isinstance(proposal, MergedEarly):
        before, group = proposal.drawn, group[proposal.group]
    if after.covariance_roots is not None:
        lower = lower_triangular(after.covariance_roots[chosen], before.shape[1])
        posteriors = lower @ lower.transpose(0, 2, 1)
    parents = proposal.ancestors[chosen]
    poses, log_weights = after.poses[chosen], after.log_likelihood[chosen]
    inherited = past.covariances[parents]
    covariances = estimate_covariances(  # 7
        model, before, poses, group, inherited, settings.reduction_share
    )
    if proposal.unseen is not None:
        covariances = keep_unseen(covariances, inherited, proposal.unseen)
    if len(posteriors) and proposal.expected is not None:
        expected, turn_deg = proposal.expected[chosen], settings.unexpected_turn_deg
        fused = fuse_with_prediction(model, poses, posteriors, expected, proposal.interval, turn_deg)
        after_fusion, before_fusion = proposal.log_prior(np.concatenate([fused, poses])).reshape(2, -1)
        log_weights = log_weights + after_fusion - before_fusion
        poses = fused
    order = np.argsort(-log_weights, kind="stable")
    poses, log_weights, parents = poses[order], log_weights[order], parents[order]
    speed = settings.usual_speed_m_s
    reported = choose_reported(model, past.reported, poses, log_weights, proposal.interval, speed)
    motion = model.moves * difference(model, past.poses[parents], poses)
    return Belief(
        poses=poses,
        log_weights=log_weights,
        residual=after.residual[chosen][order],
        velocities=motion_model(settings).update(motion, proposal.interval),
        reported=reported,
        covariances=covariances[order],
        posterior=posteriors[order[nearest_pose(poses, reported)]] if len(posteriors) else np.empty((0, 0)),
    )


def explore(
    model: BodyModel,
    past: Belief,
    observation: Observation,
    settings: FilterSettings,
    rng: np.random.Generator,
) -> Proposal:
    """Steps 2 and 3 of preset `default`: as many particles as needed, of several kinds, see `exploration`."""
    reported = past.reported_index
    motion = observation.expect(motion_model(settings).predict(past, observation.interval))
    predicted = retract(model, past.poses, motion)
    exploration = settings.exploration
    near = explain(model, predicted[reported], observation.points, exploration)
    count = choose_count(settings.particles, near, exploration, observation.cameras)
    ancestors = draw_ancestors(past.weights, count, rng)  # 2
    ancestors[0] = reported
    expected = predicted[ancestors]  # 3
    spread, data_driven = choose_kinds(count, rng, exploration, observation.cameras)
    wanted = int(data_driven.sum())
    limbs = propose_limbs(model, predicted[reported], observation.points, near, wanted, rng, exploration)
    if not limbs:
        spread |= data_driven
    noise = np.where(spread[:, None], draw_noise(past.covariances, ancestors, rng), 0.0)
    if observation.unseen is not None:  # the frame cannot tell such particles apart
        noise[:, observation.unseen] = 0.0
    particles = retract(model, expected, noise)
    if limbs:
        for n, (dofs, values) in zip(np.flatnonzero(data_driven), limbs, strict=True):
            particles[n, dofs] = values
    return Proposal(
        past, ancestors, particles, observation.interval, expected=expected, unseen=observation.unseen
    )


def merge_early(
    proposal: Proposal, after: Refined, chosen: Indices, group: Indices, min_weight: float
) -> MergedEarly:
    """The representatives of particles after the first iterations, of the modes that are not dropped.

    `chosen` and `group` are from `merge`. A mode is dropped if its weight, relative to the largest, is below
    `min_weight`.
    """
    weights = normalise(after.log_likelihood[chosen])  # the largest first
    kept = chosen[weights >= min_weight * weights[0]]
    is_kept = group < len(kept)
    assert proposal.expected is not None  # of particles of `explore`
    return MergedEarly(
        proposal.past,
        proposal.ancestors[kept],
        after.poses[kept],
        proposal.interval,
        proposal.poses[is_kept],
        group[is_kept],
        expected=proposal.expected[kept],
        unseen=proposal.unseen,
    )


def keep_unseen(covariances: Array, inherited: Array, unseen: Mask) -> Array:
    """Covariances (M, D, D) in which degrees of freedom (D,) that got no noise keep the inherited ones.

    Covariances between seen and unseen degrees of freedom are zero, because a mixture of both matrices might
    be indefinite.
    """
    both, neither = unseen[:, None] & unseen, ~unseen[:, None] & ~unseen
    return np.where(both, inherited, np.where(neither, covariances, 0.0))


def merge_refined(model: BodyModel, after: Refined, settings: FilterSettings) -> tuple[Indices, Indices]:
    """Group refined particles by their covariances, or, without these, by angles; returns that of `merge`."""
    poses, log_likelihood = after.poses, after.log_likelihood
    if after.covariance_roots is None:
        return merge_by_angle(model, poses, log_likelihood, np.deg2rad(settings.merge_angle_deg))
    lower = lower_triangular(after.covariance_roots, poses.shape[1])
    return merge_by_covariance(model, poses, log_likelihood, lower, settings.merge_variances)


def merge_by_angle(
    model: BodyModel, poses: Array, log_likelihood: Array, angle: float
) -> tuple[Indices, Indices]:
    """Group particles (N, D) that differ by less than `angle` (radians) in every rotation, as in the paper.

    Positions are not compared. Returns the same as `merge`.
    """
    turning = model.kinds == ROTATION
    return merge(model, poses, log_likelihood, lambda _, steps: np.abs(steps[:, turning]).max(axis=1) < angle)


def merge_by_covariance(
    model: BodyModel, poses: Array, log_likelihood: Array, roots: Array, variances: float
) -> tuple[Indices, Indices]:
    """Group particles (N, D) with a small Mahalanobis distance, by the covariance of the more likely one.

    Directions that a frame does not constrain, such as the twist of a forearm, do not separate particles. In
    well constrained directions millimetres separate them. `roots` (N, D, D) are Cholesky factors of
    covariances, `variances` the largest squared distance per degree of freedom. Returns the same as `merge`.
    """
    largest = variances * poses.shape[1]

    def is_near(n: int, steps: Array) -> Mask:
        whitened = solve_triangular(roots[n], steps.T, lower=True, check_finite=False)
        with np.errstate(over="ignore"):  # a worker may reply anything
            return np.asarray(np.sum(whitened**2, axis=0) < largest)

    return merge(model, poses, log_likelihood, is_near)


def merge(
    model: BodyModel, poses: Array, log_likelihood: Array, is_near: Callable[[int, Array], Mask]
) -> tuple[Indices, Indices]:
    """Group refined particles (N, D): each joins the most likely near particle, or starts a group.

    Args:
        model: The body.
        poses: The particles.
        log_likelihood: Log likelihoods (N,).
        is_near: Which particles are near the n-th, by the steps (K, D) from it to each of them.

    Returns:
        The representatives (M,) as indices of particles, the most likely first; and for each particle the
        index (N,) of its representative in this list.
    """
    left = np.argsort(-log_likelihood, kind="stable")
    chosen, group = list[int](), np.empty_like(left)
    while len(left):
        first = left[0]
        near = is_near(int(first), difference(model, poses[[first] * len(left)], poses[left]))
        near[0] = True
        group[left[near]] = len(chosen)
        chosen.append(int(first))
        left = left[~near]
    return np.array(chosen, dtype=np.int64), group


def estimate_covariances(
    model: BodyModel, before: Array, merged: Array, group: Indices, inherited: Array, reduction: float
) -> Array:
    """Covariances (M, D, D) of relative motion about each merged hypothesis, Eq. 7.

    They are computed from the particles *before* refinement, about the hypothesis after it, so that the next
    particles cover the basin of attraction of the mode. A group of one particle keeps the covariance of its
    ancestor, because Eq. 7 would have rank 1. Both are then reduced by a share.

    Args:
        model: The body.
        before: Particles (N, D) before refinement.
        merged: Hypotheses (M, D) after it.
        group: Index (N,) of the hypothesis into which each particle was merged.
        inherited: Covariances (M, D, D) of the ancestors of the representatives.
        reduction: The share by which covariances are reduced.
    """
    steps = model.moves * difference(model, merged[group], before)
    covariances = inherited.copy()
    for m in range(len(merged)):
        spread = steps[group == m]
        if len(spread) > 1:
            covariances[m] = spread.T @ spread / len(spread)
    return (1.0 - reduction) * covariances
