"""Where particles go between frames: constant velocity plus Gaussian noise (step 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.kinematics import retract

Array = NDArray[np.float64]

RANK_TOLERANCE = 1e-14  # of the largest variance: what is below it is rounding


def propagate(model: BodyModel, poses: Array, velocities: Array, noise: Array) -> Array:
    """Poses (N, D) moved by their velocities (N, D) and then by noise (N, D)."""
    return retract(model, retract(model, poses, velocities), noise)


def draw_noise(
    covariances: Array,
    ancestors: NDArray[np.int64],
    rng: np.random.Generator,
    spread: NDArray[np.bool_] | None = None,
) -> Array:
    """Gaussian noise (N, D), each with its ancestor's covariance (M, D, D), drawn in particle order.

    Ancestors (N,) are in any order; who follows a sibling costs least. Particles that are not to be `spread`
    (N,) get none.
    """
    standard = rng.standard_normal((len(ancestors), covariances.shape[1]))
    spread = np.ones(len(ancestors), dtype=np.bool_) if spread is None else spread
    noise = np.zeros_like(standard)
    shape_each(covariances, ancestors, spread, standard, noise)
    return noise


@numba.njit(cache=True, nogil=True)
def shape_each(
    covariances: Array,
    ancestors: NDArray[np.int64],
    spread: NDArray[np.bool_],
    standard: Array,
    noise: Array,
) -> None:
    """Fill noise (N, D) where it is to be spread: standard noise (N, D) with the ancestors' covariances."""
    dofs = standard.shape[1]
    root, latest = np.empty((dofs, dofs)), -1
    for n in range(len(ancestors)):
        if spread[n]:
            if ancestors[n] != latest:
                latest = ancestors[n]
                take_root(covariances[latest], root)
            for i in range(dofs):
                total = 0.0
                for j in range(dofs):
                    total += root[i, j] * standard[n, j]
                noise[n, i] = total


@numba.njit(cache=True, nogil=True)
def take_root(covariance: Array, root: Array) -> None:
    """Fill root (D, D) so that root root^T is the covariance (D, D), of whatever rank.

    Cholesky's method with the largest pivot first, until what is left is rounding.
    """
    rest = covariance.copy()
    root[:] = 0.0
    least = RANK_TOLERANCE * np.max(np.diag(rest))
    for k in range(len(rest)):
        pivot = np.argmax(np.diag(rest))
        if not rest[pivot, pivot] > least:
            return
        column = rest[:, pivot] / np.sqrt(rest[pivot, pivot])  # in a row, so that several go at once
        root[:, k] = column
        for i in range(len(rest)):
            for j in range(len(rest)):
                rest[i, j] -= column[i] * column[j]
        rest[pivot, pivot] = 0.0
