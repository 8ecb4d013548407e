"""The noise of depth by distance, by which the room and a person are distinguished."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.compiling import numba

LEAST = 0.001  # metres, at any distance
GROWTH = (0.0003, 0.03)  # metres per square metre of distance: smallest and largest
USUAL_GROWTH = 0.0015  # of usual depth cameras
DEVIATIONS = 4.0  # standard deviations; smaller differences are noise
ONE_DEVIATION = 68.3  # per cent of a Gaussian within one standard deviation


def sigma(z: Array, growth: float) -> Array:
    """Standard deviation of the noise at depths z, metres: 1 mm + growth z^2."""
    return LEAST + growth * z * z


@numba.njit(cache=True, nogil=True, inline="always")
def margin_at(z: float, growth: float) -> float:
    """Least difference in depth, metres, by which two surfaces can be distinguished at a depth."""
    return DEVIATIONS * (LEAST + growth * z * z)


def fit_noise(depth_m: NDArray[np.floating]) -> float:
    """The growth of the noise of a depth image (H, W) in metres, with 0 for no depth.

    It is estimated from second differences of three successive pixels, in which smooth surfaces nearly
    cancel. The median is not usable: with coarse rounding, more than half of the differences are zero.
    """
    left, middle, right = depth_m[:, :-2], depth_m[:, 1:-1], depth_m[:, 2:]
    measured = (left > 0.0) & (middle > 0.0) & (right > 0.0)
    if not measured.any():
        return USUAL_GROWTH
    z = middle[measured].astype(np.float64)
    bend = np.abs(left[measured].astype(np.float64) - 2.0 * z + right[measured]) / np.sqrt(6.0)
    return float(np.clip(np.percentile((bend - LEAST) / (z * z), ONE_DEVIATION), *GROWTH))
