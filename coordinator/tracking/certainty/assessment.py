"""From evidence to how sure each joint is: a logistic and a log-linear function, fitted to people."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from coordinator.tracking.certainty.certainty import Certainty
from coordinator.tracking.certainty.evidence import CLUES
from coordinator.tracking.certainty.fitted import DEVIATION, FITTED, PROBABILITY

Array = NDArray[np.float64]

MEMORY = (
    0.116  # seconds in which what was known of a joint fades to a third: who is lost stays so for a while
)


def conclude(evidence: Array, verdict: Array) -> Certainty:
    """How sure the joints are, from a frame's evidence (J, K) and the verdict (J, 2) about it."""
    return Certainty(evidence[:, 0].copy(), 1.0 / (1.0 + np.exp(-verdict[:, 0])), np.exp(verdict[:, 1]))


def judge_evidence(evidence: Array) -> Array:
    """Log odds that joints are off, and the logarithm of their deviation (J, 2), from evidence (J, K)."""
    _, _, off, deviation = table()
    within = limit(evidence)
    return np.stack([PROBABILITY + within @ off, DEVIATION + within @ deviation], axis=1)


def limit(evidence: Array) -> Array:
    """Evidence (..., K) within what the functions were fitted to: what goes beyond counts as its limit."""
    low, high, _, _ = table()
    within: Array = np.clip(np.nan_to_num(evidence), low, high)
    return within


def recall(now: Array, before: Array | None, interval: float) -> Array:
    """What is known now, averaged with what was known an interval (seconds) ago, if anything was."""
    if before is None:
        return now
    kept = math.exp(-interval / MEMORY)
    return kept * before + (1.0 - kept) * now


def table() -> Array:
    """The least and the most of each clue, and its weights, (4, K)."""
    return np.array([FITTED[clue] for clue in CLUES]).T
