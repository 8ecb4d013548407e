"""The certainty of each joint in a frame: a logistic function of features, fitted to people."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.coordinator.settings import CertaintySettings

if TYPE_CHECKING:  # a report reads this module, and loads no compiled code for it
    from gepf.coordinator.tracking.certainty.features import Features


@dataclass(frozen=True, slots=True, eq=False)
class Certainty:
    """The certainty of each joint (J,) in a frame; NaN if the pose is unknown."""

    seen: Array  # visible share of the surface around the joint that faces the camera that sees it best
    off_probability: Array  # probability that it is wrong: an error above 15 cm, or as the settings say
    deviation: Array  # expected distance from the true joint, one standard deviation, metres


def log_odds(features: Features, settings: CertaintySettings) -> Array:
    """Log odds that joints are wrong, for features of any shape."""
    weights = msgspec.structs.asdict(settings.fit.weights)
    odds = sum((weight * getattr(features, name) for name, weight in weights.items()), settings.fit.intercept)
    return np.asarray(np.clip(odds, -settings.max_nats, settings.max_nats))


def judge(features: Features, settings: CertaintySettings, in_view: Mask | None = None) -> Certainty:
    """The certainty of joints (J,); those that are not `in_view` are outside of the image, or hidden."""
    fit, odds = settings.fit, log_odds(features, settings)
    hidden = fit.log_deviation_hidden * (1.0 - features.seen)
    deviation = np.exp(fit.log_deviation + fit.log_deviation_odds * odds + hidden)
    if in_view is not None:
        odds = odds + np.where(in_view, 0.0, settings.out_of_view_nats)
    return Certainty(features.seen, 1.0 / (1.0 + np.exp(-odds)), deviation)


def unknown_certainty(joints: int) -> Certainty:
    """The certainty in a frame without a known pose."""
    return Certainty(*np.full((3, joints), np.nan))
