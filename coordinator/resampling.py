"""Drawing ancestors from weighted hypotheses (step 2)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
    positions = (np.arange(count) + rng.random()) / count
    cumulative = np.cumsum(weights) / np.sum(weights)
    last = int(np.flatnonzero(weights > 0.0)[-1])
    return np.minimum(np.searchsorted(cumulative, positions, side="right"), last).astype(np.int64)
