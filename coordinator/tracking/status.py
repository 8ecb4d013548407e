"""How sure the tracker is of a frame, in one word."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coordinator.tracking.estimate import Status
from coordinator.tracking.search.watch import Watch

Array = NDArray[np.float64]

APART = 0.15  # metres, between a joint of one hypothesis and of another
RIVAL = 0.5  # weight of a hypothesis, relative to the likeliest, from which on it is a rival


def judge(watch: Watch, weights: Array, joints: Array) -> Status:
    """Status of a frame that shows something, from weights (M,) and joints (M, J, 3), likeliest first.

    `searching`: the body may be anywhere. `lost`: the reported pose does not explain what is seen.
    `ambiguous`: a hypothesis about as likely has some joint elsewhere.
    """
    if watch.seeks:
        return "searching"
    if watch.unexplained:
        return "lost"
    apart = np.linalg.norm(joints - joints[:1], axis=-1).max(axis=1)
    if np.any((apart > APART) & (weights > RIVAL * weights[0])):
        return "ambiguous"
    return "tracked"
