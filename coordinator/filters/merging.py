"""Merging of refined particles into hypotheses, and their covariances (steps 6 and 7)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import solve_triangular

from common.arrays import Array, Indices, Mask
from common.body import ROTATION, BodyModel
from common.kinematics import difference

MERGE_VARIANCES = 2.0 / 3.0  # squared Mahalanobis distance per degree of freedom


def merge_by_angle(
    model: BodyModel, poses: Array, log_likelihood: Array, angle: float
) -> tuple[Indices, Indices]:
    """Group particles (N, D) that differ by less than `angle` (radians) in every rotation, as in the paper.

    Positions are not compared. Returns the same as `merge`.
    """
    turning = model.kinds == ROTATION
    return merge(model, poses, log_likelihood, lambda _, steps: np.abs(steps[:, turning]).max(axis=1) < angle)


def merge_by_covariance(
    model: BodyModel, poses: Array, log_likelihood: Array, roots: Array
) -> tuple[Indices, Indices]:
    """Group particles (N, D) with a small Mahalanobis distance, by the covariance of the more likely one.

    Directions that a frame does not constrain, such as the twist of a forearm, do not separate particles. In
    well constrained directions millimetres separate them. `roots` (N, D, D) are Cholesky factors of
    covariances. Returns the same as `merge`.
    """
    rim = MERGE_VARIANCES * poses.shape[1]

    def is_near(n: int, steps: Array) -> Mask:
        whitened = solve_triangular(roots[n], steps.T, lower=True, check_finite=False)
        with np.errstate(over="ignore"):  # a worker may reply anything
            return np.asarray(np.sum(whitened**2, axis=0) < rim)

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
    ancestor, because Eq. 7 would have rank 1. Both are then reduced.

    Args:
        model: The body.
        before: Particles (N, D) before refinement.
        merged: Hypotheses (M, D) after it.
        group: Index (N,) of the hypothesis into which each particle was merged.
        inherited: Covariances (M, D, D) of the ancestors of the representatives.
        reduction: Share by which every covariance is reduced in each frame.
    """
    steps = difference(model, merged[group], before)
    covariances = inherited.copy()
    for m in range(len(merged)):
        spread = steps[group == m]
        if len(spread) > 1:
            covariances[m] = spread.T @ spread / len(spread)
    return (1.0 - reduction) * covariances
