"""Refined particles that are one hypothesis, and how far its children are spread (steps 6 and 7)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.compiling import numba
from common.kinematics import difference

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MERGE_VARIANCES = 2.0 / 3.0  # mean squared distance in each degree of freedom, over its variance


def merge_by_angle(
    model: BodyModel, poses: Array, log_likelihood: Array, angle: float
) -> tuple[Indices, Indices]:
    """Group particles (N, D) that differ by less than `angle` (radians) in every rotation, as the paper does.

    Positions are not compared. Returns as `merge`.
    """
    turning = model.kinds == ROTATION
    return merge(model, poses, log_likelihood, lambda _, steps: np.abs(steps[:, turning]).max(axis=1) < angle)


def merge_by_covariance(
    model: BodyModel, poses: Array, log_likelihood: Array, roots: Array
) -> tuple[Indices, Indices]:
    """Group particles (N, D) that are near by the Mahalanobis distance of the likelier one.

    Directions that a frame does not constrain, such as the twist of a forearm, do not separate particles; in
    well constrained ones millimetres do. `roots` (N, D, D) are Cholesky factors of covariances. Returns as
    `merge`.
    """
    rim = MERGE_VARIANCES * poses.shape[1]
    return merge(model, poses, log_likelihood, lambda n, steps: are_within(roots[n], steps, rim))


@numba.njit(cache=True, nogil=True)
def are_within(root: Array, steps: Array, squared: float) -> NDArray[np.bool_]:
    """Which steps (K, D) have less than a squared Mahalanobis length, by a Cholesky factor (D, D)."""
    within = np.empty(len(steps), dtype=np.bool_)
    whitened = np.empty(len(root))
    for k in range(len(steps)):
        total = 0.0
        for i in range(len(root)):
            rest = steps[k, i]
            for j in range(i):
                rest -= root[i, j] * whitened[j]
            whitened[i] = rest / root[i, i]
            total += whitened[i] * whitened[i]
        within[k] = total < squared
    return within


def merge(
    model: BodyModel,
    poses: Array,
    log_likelihood: Array,
    is_near: Callable[[int, Array], NDArray[np.bool_]],
) -> tuple[Indices, Indices]:
    """Group refined particles (N, D): each joins the likeliest one (N,) that is near, or stands for a group.

    Args:
        model: The body.
        poses: The particles.
        log_likelihood: Of each.
        is_near: Which particles are near the n-th, by the steps (K, D) from it to each of them.

    Returns:
        The representatives (M,) as indices of particles, likeliest first, and for each particle the
        place (N,) of its representative among them.
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

    Taken from the particles *before* their descent, about the hypothesis after it, so that the next ones
    cover the mode's basin of attraction. A group of one particle keeps its parent's covariance, as Eq. 7
    would have rank 1. Both are then reduced.

    Args:
        model: The body.
        before: Particles (N, D) before their descent.
        merged: Hypotheses (M, D) after it.
        group: For each particle (N,) the hypothesis it merged into.
        inherited: Covariance (M, D, D) of the hypothesis that each representative was drawn from.
        reduction: Share by which every covariance shrinks each frame.
    """
    steps = difference(model, merged[group], before)
    covariances = inherited.copy()
    for m in range(len(merged)):
        spread = steps[group == m]
        if len(spread) > 1:
            covariances[m] = spread.T @ spread / len(spread)
    return (1.0 - reduction) * covariances
