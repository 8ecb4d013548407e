"""How far depth may be off at each distance, so that what is the room's is not taken for a person."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba

LEAST = 0.001  # metres at any distance
GROWTH = (0.0003, 0.03)  # metres for each square metre of distance: the least and the most
DEVIATIONS = 3.5  # standard deviations that are noise
ROUNDING = 0.008  # metres on top of it
STEP = 0.03  # metres between neighbouring pixels of one surface, the noise aside


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """Standard deviation 1 mm + growth z^2 of a depth of z metres."""

    growth: float = 0.0015

    def sigma(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Standard deviations at depths, metres."""
        return LEAST + self.growth * z * z

    def margin(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far two things must be apart along the line of sight to be told apart, metres."""
        return DEVIATIONS * self.sigma(z) + ROUNDING


@numba.njit(cache=True, nogil=True, inline="always")
def margin_at(z: float, growth: float) -> float:
    """The margin of a single depth, metres."""
    return DEVIATIONS * (LEAST + growth * z * z) + ROUNDING


@numba.njit(cache=True, nogil=True, inline="always")
def step_at(z: float, growth: float) -> float:
    """How far neighbouring pixels of one surface may be apart at a depth, metres."""
    return STEP + margin_at(z, growth)


def fit_noise(depth_m: NDArray[np.floating]) -> DepthNoise:
    """The noise of a depth image (H, W) in metres, 0 where nothing was measured.

    From the second differences of three pixels in a row, in which surfaces as good as vanish. Not by their
    median: where a camera rounds coarsely, more than half of them are zero.
    """
    left, middle, right = depth_m[:, :-2], depth_m[:, 1:-1], depth_m[:, 2:]
    measured = (left > 0.0) & (middle > 0.0) & (right > 0.0)
    if not measured.any():
        return DepthNoise()
    z = middle[measured].astype(np.float64)
    bend = np.abs(left[measured].astype(np.float64) - 2.0 * z + right[measured]) / np.sqrt(6.0)
    growth = float(np.percentile((bend - LEAST) / (z * z), ONE_DEVIATION))
    return DepthNoise(float(np.clip(growth, *GROWTH)))


ONE_DEVIATION = 68.3  # per cent of a Gaussian
