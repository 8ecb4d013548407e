"""The noise of a depth camera, measured in one image.

`DepthNoise` is used to separate a person from the room, `SensorNoise` to weight the points of a body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gepf.common.arrays import Array, Mask
from gepf.common.compiling import numba
from gepf.common.frame import View
from gepf.common.settings import RefineSettings
from gepf.coordinator.settings import NoiseSettings

ONE_DEVIATION = 68.3  # per cent of a Gaussian within one standard deviation


class DepthNoise(NamedTuple):
    """The noise of a camera's depth z in metres: standard deviation floor + growth z^2."""

    growth: float  # metres of standard deviation added at a depth of 1 m
    floor_m: float
    margin_deviations: float  # smaller differences of depth are noise

    def sigma(self, z: Array) -> Array:
        """The standard deviation at depths z, metres."""
        return self.floor_m + self.growth * z * z

    def margin(self, z: Array) -> Array:
        """The smallest difference, metres, by which two surfaces can be distinguished at depths z, metres."""
        return self.margin_deviations * self.sigma(z)


def noise_of(growth: float, settings: NoiseSettings) -> DepthNoise:
    """The noise with this growth, metres added at 1 m."""
    return DepthNoise(growth, settings.floor_m, settings.margin_deviations)


@numba.njit(cache=True, nogil=True, inline="always")
def margin_at(z: float, noise: DepthNoise) -> float:
    """`DepthNoise.margin` at one depth, compiled."""
    return noise.margin_deviations * (noise.floor_m + noise.growth * z * z)


def fit_growth(depth_m: NDArray[np.floating], settings: NoiseSettings) -> float:
    """The growth of the noise of a depth image (H, W) in metres, with 0 for no depth.

    It is estimated from second differences of three successive pixels, in which smooth surfaces nearly
    cancel. The median cannot be used: with coarse quantisation, more than half of the differences are zero.
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


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviations of a measured point along the line of sight and across it, metres, at a distance.

    The first grows with the square of the distance (`DepthNoise`), the second linearly.
    """

    depth: float
    lateral: float
    distance: float = 0.0  # metres; 0 if the noise does not depend on the distance

    def at(self, distance: float, floor_m: float) -> SensorNoise:
        """The noise at another distance, metres; one part of it, the floor, is the same at all distances.

        The distance is rounded to steps of 10 %, so that most frames get the same settings.
        """
        if not (self.distance > 0.0 and distance > 0.0):
            return self
        step = 0.1
        ratio = math.exp(step * round(math.log(distance / self.distance) / step))
        depth = min(self.depth, floor_m) + max(0.0, self.depth - floor_m) * ratio * ratio
        return SensorNoise(depth, self.lateral * ratio, self.distance * ratio)


NO_NOISE = SensorNoise(0.0, 0.0)


def measure_noise(view: View, settings: NoiseSettings) -> SensorNoise:
    """The noise of an image that is not empty, at the median distance of its pixels.

    Quantisation is part of the noise. Errors that are common to neighbouring pixels are not measured.
    """
    depth_m = view.metres()
    distance = float(np.median(depth_m[depth_m > 0.0]))
    metres_per_pixel = distance / view.intrinsics.fx
    noise = fit_noise(depth_m, settings)
    deviation = float(noise.sigma(np.array(distance))) if noise.growth > settings.min_growth_m else 0.0
    lateral_px = outline_deviation(depth_m > 0.0, settings.outline_blur_px)
    return SensorNoise(deviation, lateral_px * metres_per_pixel, distance)


def outline_deviation(mask: Mask, blur_px: float) -> float:
    """Standard deviation in pixels of the independent displacement of the pixels of a silhouette (H, W).

    Near a straight outline a pixel at distance x is inside with probability Phi(x / s). So neighbours differ
    2 s / sqrt(pi) times in each row that crosses it; without noise, once. In the sum over rows and columns
    the direction of the outline cancels, and the ratio to a smooth outline is sqrt(pi) s.
    """
    padded = np.pad(mask, int(4 * blur_px)).astype(np.float64)
    smooth = count_changes(gaussian_filter(padded, blur_px) > 0.5)
    frayed = count_changes(padded > 0.5)
    return frayed / smooth / math.sqrt(math.pi) if smooth else 0.0


def count_changes(mask: Mask) -> int:
    """Number of pairs of neighbours of which exactly one is inside."""
    return int(np.sum(mask[:, 1:] != mask[:, :-1]) + np.sum(mask[1:] != mask[:-1]))


def assume_noise(settings: RefineSettings, noise: SensorNoise) -> RefineSettings:
    """Settings with at least this noise. Their own noise also covers the error of the surface.

    The lateral noise is capped at the depth noise, because a rougher outline has other causes.
    """
    depth = max(settings.noise_depth, noise.depth)
    lateral = min(max(settings.noise_lateral, noise.lateral), depth)
    return msgspec.structs.replace(settings, noise_depth=depth, noise_lateral=lateral)
