"""The size and shape of a valley, from the particles that fell into it (step 7, Eq. 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.kinematics import difference
from common.refinement import lower_triangular

Array = NDArray[np.float64]

TARGET_WORTH = 20.0  # particles


def estimate_covariances(
    model: BodyModel,
    before: Array,
    merged: Array,
    group: NDArray[np.int64],
    inherited: Array,
    reduction: float,
) -> Array:
    """Covariances (M, D, D) of relative motion about each merged hypothesis, Eq. 7.

    Taken from the particles *before* their descent, about the hypothesis after it, so that the next ones
    are drawn out to the valley's rim. A lone particle shows nothing of its valley's size (Eq. 7 would
    leave a single direction): it keeps what it inherited. Both are then reduced.

    Args:
        model: The body.
        before: Particles (N, D) before their descent.
        merged: Hypotheses (M, D) after it.
        group: For each particle (N,) the hypothesis it merged into.
        inherited: Covariance (M, D, D) of the hypothesis that each representative was drawn from.
        reduction: Share by which every covariance shrinks each frame.
    """
    covariances = np.array(inherited, dtype=np.float64, order="C")
    gather_squares(difference(model, merged[group], before), group, 1.0 - reduction, covariances)
    return covariances


def found_by_descent(roots: NDArray[np.float32], dofs: int) -> Array:
    """Covariances (M, D, D) from their Cholesky factors' lower triangles (M, D (D + 1) / 2)."""
    lower = lower_triangular(roots, dofs)
    covariances: Array = lower @ lower.transpose(0, 2, 1)
    return covariances


def shrink(covariances: Array, found: Array, group: NDArray[np.int64]) -> Array:
    """Covariances (M, D, D) of groups, drawn to those that the descent found at their hypotheses.

    A group shows no more directions than it has particles, so what was found counts as much as TARGET_WORTH
    of them; a lone particle has it alone.

    Args:
        covariances: As `estimate_covariances` gives them.
        found: What was found (M, D, D).
        group: For each particle (N,) the hypothesis it merged into.
    """
    shrunk = np.empty_like(covariances)
    blend_groups(covariances, found, group, shrunk)
    return shrunk


@numba.njit(cache=True, nogil=True)
def blend_groups(covariances: Array, found: Array, group: NDArray[np.int64], shrunk: Array) -> None:
    """Fill shrunk (M, D, D) as `shrink` gives it."""
    members = np.zeros(len(covariances), dtype=np.int64)
    for m in group:
        members[m] += 1
    for m in range(len(covariances)):
        share = members[m] / (members[m] + TARGET_WORTH) if members[m] > 1 else 0.0
        for i in range(covariances.shape[1]):
            for j in range(covariances.shape[1]):
                shrunk[m, i, j] = share * covariances[m, i, j] + (1.0 - share) * found[m, i, j]


@numba.njit(cache=True, nogil=True)
def gather_squares(spread: Array, group: NDArray[np.int64], share: float, covariances: Array) -> None:
    """Replace the covariances (M, D, D) of groups of more than one by the mean square of their spread (N, D).

    Each is then multiplied by a share.
    """
    members = np.zeros(len(covariances), dtype=np.int64)
    for m in group:
        members[m] += 1
    for m in range(len(covariances)):
        if members[m] > 1:
            covariances[m] = 0.0
    for n in range(len(group)):
        covariance = covariances[group[n]]
        if members[group[n]] > 1:
            for i in range(spread.shape[1]):
                for j in range(spread.shape[1]):
                    covariance[i, j] += spread[n, i] * spread[n, j]
    for m in range(len(covariances)):
        covariances[m] *= share / members[m] if members[m] > 1 else share
