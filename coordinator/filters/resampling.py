"""Drawing ancestors from weighted hypotheses (step 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba

Array = NDArray[np.float64]


def normalise(log_weights: Array) -> Array:
    """Weights (M,) that sum to 1. Where every log weight is -inf, all are equal."""
    if not np.any(np.isfinite(log_weights)):
        return np.full(len(log_weights), 1.0 / len(log_weights))
    weights = np.exp(log_weights - np.max(log_weights))
    normalised: Array = weights / weights.sum()
    return normalised


def effective_sample_size(weights: Array) -> float:
    """1 / sum of squares of normalised weights: 1 when one has all, M when all are equal."""
    return float(1.0 / np.sum(weights**2))


def systematic(weights: Array, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Ancestors (count,), ascending, by systematic resampling: each is drawn w count times, give or take one.

    A hypothesis of zero weight is never drawn.
    """
    ancestors = np.empty(count, dtype=np.int64)
    select(weights, rng.random(), ancestors)
    return ancestors


@numba.njit(cache=True, nogil=True)
def select(weights: Array, offset: float, ancestors: NDArray[np.int64]) -> None:
    """Fill ancestors (N,): who is at (n + offset) / N where all weights (M,) are stacked up."""
    total = np.sum(weights)
    m = last = 0
    for k in range(len(weights)):
        if weights[k] > 0.0:
            last = k
    below = weights[0]
    for n in range(len(ancestors)):
        while m < last and below <= (n + offset) / len(ancestors) * total:
            m += 1
            below += weights[m]
        ancestors[n] = m
