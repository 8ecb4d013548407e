"""How far depth may be off at each distance, so that the room is not taken for a person."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba

LEAST = 0.001  # metres at any distance
GROWTH = (0.0003, 0.03)  # metres for each square metre of distance: the least and the most
USUAL_GROWTH = 0.0015  # of depth cameras
DEVIATIONS = 4.0  # standard deviations that are noise
ONE_DEVIATION = 68.3  # per cent of a Gaussian


def sigma(z: NDArray[np.float64], growth: float) -> NDArray[np.float64]:
    """Standard deviation of the noise at depths z, metres: 1 mm + growth z^2."""
    return LEAST + growth * z * z


@numba.njit(cache=True, nogil=True, inline="always")
def margin_at(z: float, growth: float) -> float:
    """How far two things must be apart along the line of sight to be told apart at a depth, metres."""
    return DEVIATIONS * (LEAST + growth * z * z)


def fit_noise(depth_m: NDArray[np.floating]) -> float:
    """The growth of the noise of a depth image (H, W) in metres, 0 where nothing was measured.

    From the second differences of three pixels in a row, in which surfaces nearly vanish. Not by their
    median: where a camera rounds coarsely, more than half of them are zero.
    """
    left, middle, right = depth_m[:, :-2], depth_m[:, 1:-1], depth_m[:, 2:]
    measured = (left > 0.0) & (middle > 0.0) & (right > 0.0)
    if not measured.any():
        return USUAL_GROWTH
    z = middle[measured].astype(np.float64)
    bend = np.abs(left[measured].astype(np.float64) - 2.0 * z + right[measured]) / np.sqrt(6.0)
    return float(np.clip(np.percentile((bend - LEAST) / (z * z), ONE_DEVIATION), *GROWTH))
