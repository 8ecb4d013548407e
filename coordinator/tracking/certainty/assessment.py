"""From evidence to how sure each joint is: a logistic and a log-linear function, fitted to people."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from coordinator.tracking.certainty.certainty import Certainty
from coordinator.tracking.certainty.evidence import CLUES
from coordinator.tracking.certainty.fitted import DEVIATION, FITTED, PROBABILITY, UNSEEN

Array = NDArray[np.float64]

MEMORY = (
    0.116  # seconds in which what was known of a joint fades to a third: who is lost stays so for a while
)


LEFT_OVER = np.array([5.0, 3.0])
"""Log odds and log deviation for each e-fold of surface that nothing explains, beyond MUCH_LEFT.

People leave some over where every joint is in place (clothes, hair), so the fit to them gives little for it.
But a limb that is lost before the trunk, behind heavy noise, shows by nothing else: found on the paper's arm
as `--method gradient` loses it. Of the joints of subjects 1 and 2 that are in place it flags 0.5 % more.
"""
MUCH_LEFT = -4.83  # as the clue has it: 60 cm^2
MOST_LEFT = 0.8  # e-folds beyond it that count

LONE = 1.05
"""Log odds of being off that a single particle has beyond the fit, which is to many that check each other.

Where `--method gradient` tracks the hard actions of subjects 1 and 2 at 10 frames a second, 5.3 % of the
joints are off. 0.72 would say so, this says 6.6 %: it flags 95 % of the frames in which a limb is lost.
"""

LEFT, SHOWN = CLUES.index("unexplained"), CLUES.index("shown")
HIDDEN = 0.5  # share of a joint's surface below which it is hidden, and farther off of people not fitted


def conclude(evidence: Array, verdict: Array) -> Certainty:
    """How sure the joints are, from a frame's evidence (J, K) and the verdict (J, 2) about it."""
    return Certainty(evidence[:, 0].copy(), 1.0 / (1.0 + np.exp(-verdict[:, 0])), np.exp(verdict[:, 1]))


@dataclass(frozen=True, slots=True, eq=False)
class Functions:
    """The least and the most of each clue (K,), and an intercept and weights (K,) for each function."""

    low: Array
    high: Array
    probability: tuple[float, Array]  # log odds that a joint is off
    deviation: tuple[float, Array]  # logarithm of how far, metres
    unseen: float = 0.0  # added to it for hidden joints, of people that were not fitted

    def judge(self, evidence: Array, *, lone: bool = False) -> Array:
        """Log odds that joints are off, and the logarithm of how far (..., 2), from evidence (..., K).

        lone: whether a single particle was drawn.
        """
        within = limit(evidence, self.low, self.high)
        judged = np.empty((*evidence.shape[:-1], 2))
        for which, (intercept, weights) in enumerate((self.probability, self.deviation)):
            judged[..., which] = intercept + within @ weights
        judged[..., 0] += LONE * lone
        judged[..., 1] += self.unseen * is_hidden(evidence)
        return judged + add_left_over(evidence)


@cache
def built_in() -> Functions:
    """What the tracker goes by."""
    table = np.array([FITTED[clue] for clue in CLUES])
    table.setflags(write=False)
    low, high, probability, deviation = table.T
    return Functions(low, high, (PROBABILITY, probability), (DEVIATION, deviation), UNSEEN)


def is_hidden(evidence: Array) -> NDArray[np.bool_]:
    """Of which joints (...) less than half is shown, by evidence (..., K)."""
    hidden: NDArray[np.bool_] = ~(evidence[..., SHOWN] >= HIDDEN)
    return hidden


def add_left_over(evidence: Array) -> Array:
    """What unexplained surface adds to log odds and log deviation (..., 2), from evidence (..., K)."""
    beyond = numbers(evidence[..., LEFT]) - MUCH_LEFT
    added: Array = np.clip(beyond, 0.0, MOST_LEFT)[..., None] * LEFT_OVER
    return added


def limit(evidence: Array, low: Array, high: Array) -> Array:
    """Evidence (..., K) within what functions were fitted to (K,): what goes beyond counts as its limit."""
    within: Array = np.clip(numbers(evidence), low, high)
    return within


def numbers(evidence: Array) -> Array:
    """Evidence in which what is no number counts as 0; mostly all of it is."""
    return evidence if np.isfinite(evidence).all() else np.nan_to_num(evidence)


def recall(now: Array, before: Array | None, interval: float) -> Array:
    """What is known now, averaged with what was known an interval (seconds) ago, if anything was."""
    if before is None:
        return now
    kept = math.exp(-interval / MEMORY)
    return kept * before + (1.0 - kept) * now
