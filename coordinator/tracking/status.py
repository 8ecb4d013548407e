"""How sure the tracker is of a frame, in one word."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coordinator.tracking.estimate import Status

Array = NDArray[np.float64]

LOST_RESIDUAL = 0.10  # metres, mean distance of observed points from the model
APART = 0.15  # metres, between a joint of one hypothesis and of another
RIVAL = 0.5  # weight of a hypothesis, relative to the likeliest, from which on it is a rival


def judge(residual: float, noise: float, weights: Array, joints: Array) -> Status:
    """Status from the reported residual (m), the weights (M,) and joints (M, J, 3), likeliest first.

    `lost`: the reported pose does not explain what is seen, the depth's `noise` (m) aside.
    `ambiguous`: a hypothesis about as likely has some joint elsewhere.
    """
    if not residual <= LOST_RESIDUAL + noise:
        return "lost"
    apart = np.linalg.norm(joints - joints[:1], axis=-1).max(axis=1)
    if np.any((apart > APART) & (weights > RIVAL * weights[0])):
        return "ambiguous"
    return "tracked"
