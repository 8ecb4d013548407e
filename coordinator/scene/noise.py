"""The noise of depth by distance, by which the room and a person are distinguished."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.coordinator.settings import NoiseSettings

ONE_DEVIATION = 68.3  # per cent of a Gaussian within one standard deviation


class DepthNoise(NamedTuple):
    """The noise of a camera's depth z in metres: standard deviation floor + growth z^2."""

    growth: float  # metres at 1 m
    floor_m: float
    margin_deviations: float  # smaller differences of depth are noise

    def sigma(self, z: Array) -> Array:
        """The standard deviation at depths z, metres."""
        return self.floor_m + self.growth * z * z

    def margin(self, z: Array) -> Array:
        """The least difference, metres, by which two surfaces can be distinguished at depths z, metres."""
        return self.margin_deviations * self.sigma(z)


def noise_of(growth: float, settings: NoiseSettings) -> DepthNoise:
    """The noise with this growth, metres at 1 m."""
    return DepthNoise(growth, settings.floor_m, settings.margin_deviations)


@numba.njit(cache=True, nogil=True, inline="always")
def margin_at(z: float, noise: DepthNoise) -> float:
    """`DepthNoise.margin` at one depth, compiled."""
    return noise.margin_deviations * (noise.floor_m + noise.growth * z * z)


def fit_growth(depth_m: NDArray[np.floating], settings: NoiseSettings) -> float:
    """The growth of the noise of a depth image (H, W) in metres, with 0 for no depth.

    It is estimated from second differences of three successive pixels, in which smooth surfaces nearly
    cancel. The median is not usable: with coarse rounding, more than half of the differences are zero.
    """
    left, middle, right = depth_m[:, :-2], depth_m[:, 1:-1], depth_m[:, 2:]
    measured = (left > 0.0) & (middle > 0.0) & (right > 0.0)
    if not measured.any():
        return settings.usual_growth_m
    z = middle[measured].astype(np.float64)
    bend = np.abs(left[measured].astype(np.float64) - 2.0 * z + right[measured]) / np.sqrt(6.0)
    growth = np.percentile((bend - settings.floor_m) / (z * z), ONE_DEVIATION)
    return float(np.clip(growth, settings.min_growth_m, settings.max_growth_m))


def fit_noise(depth_m: NDArray[np.floating], settings: NoiseSettings) -> DepthNoise:
    """The noise of a depth image (H, W) in metres, see `fit_growth`."""
    return noise_of(fit_growth(depth_m, settings), settings)
