"""The certainty of each joint in a frame: a logistic function of features, fitted to people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gepf.common.arrays import Array, Mask

if TYPE_CHECKING:  # a report reads this module, and loads no compiled code for it
    from gepf.coordinator.tracking.certainty.features import Features


OFF = 0.15  # distance in metres from the true joint above which a joint is wrong
JOINTS_OFF = f"may be more than {100 * OFF:.0f} cm off: "  # before the names of doubted joints
FLAGGED = 0.04  # least probability of a flagged joint; 4 to 9 % of the correct joints are flagged
SUSPECTED = 0.15  # probability above which the frame is ambiguous
OUT_OF_VIEW = 1.0  # log odds in addition to those of a joint that the body hides; real people cut at the hips
MOST_LOG_ODDS = 10.0  # beyond which nothing was measured


@dataclass(frozen=True, slots=True, eq=False)
class Certainty:
    """The certainty of each joint (J,) in a frame; NaN if the pose is unknown."""

    seen: Array  # visible share of the surface around the joint that faces the camera that sees it best
    off_probability: Array  # probability of an error above 15 cm
    deviation: Array  # expected distance from the true joint, one standard deviation, metres


@dataclass(frozen=True, slots=True)
class Fit:
    """Log odds that a joint is wrong, linear in the features, and its deviation, a function of them."""

    intercept: float
    weights: dict[str, float]  # log odds for each unit of a feature, see `Features`
    deviation: tuple[float, float, float]  # log metres: intercept, of the log odds, of the hidden share

    def log_odds(self, features: Features) -> Array:
        """Log odds that joints are wrong, for features of any shape."""
        found = sum((w * getattr(features, name) for name, w in self.weights.items()), self.intercept)
        return np.asarray(np.clip(found, -MOST_LOG_ODDS, MOST_LOG_ODDS))

    def judge(self, features: Features, in_view: Mask | None = None) -> Certainty:
        """The certainty of joints (J,); those that are not `in_view` are outside of the image, or hidden."""
        log_odds = self.log_odds(features)
        intercept, odds, hidden = self.deviation
        deviation = np.exp(intercept + odds * log_odds + hidden * (1.0 - features.seen))
        if in_view is not None:
            log_odds = log_odds + np.where(in_view, 0.0, OUT_OF_VIEW)
        return Certainty(features.seen, 1.0 / (1.0 + np.exp(-log_odds)), deviation)


FIT = Fit(
    intercept=-3.709,
    weights={
        "seen": -4.104,
        "residual": 5.663,
        "misfit": 31.40,
        "spread": 0.4338,
        "speed": 0.1079,
        "bend": 0.2408,
        "folding": 0.8651,
        "crowding": 0.8829,
        "protrusion": 3.825,
    },
    deviation=(-1.669, 0.3051, 0.2034),
)
"""Fitted by `python -m benchmarks.certainty --fit`."""


def unknown_certainty(joints: int) -> Certainty:
    """The certainty in a frame without a known pose."""
    return Certainty(*np.full((3, joints), np.nan))
