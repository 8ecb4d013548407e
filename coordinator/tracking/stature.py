"""A prior of stature, for people of whom a part is in view: a part fits a range of sizes."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array

ADULT_M, ADULT_DEVIATION_M = 1.69, 0.10  # mean and deviation of the statures of adults


def log_prior(statures: Array) -> Array:
    """Log density of statures (N,), metres, up to a constant: children are as likely as the mean adult."""
    above = np.maximum(0.0, (statures - ADULT_M) / ADULT_DEVIATION_M)
    return np.asarray(-0.5 * above**2)
