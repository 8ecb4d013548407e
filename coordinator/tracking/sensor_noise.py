"""The noise of a camera, measured in one depth image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.ndimage import gaussian_filter

from gepf.common.arrays import Mask
from gepf.common.frame import DepthFrame
from gepf.common.settings import RefineSettings
from gepf.coordinator.scene.noise import fit_noise
from gepf.coordinator.settings import NoiseSettings


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviations of a measured point along the line of sight and across it, metres, at a distance.

    The first grows with the square of the distance (`gepf.coordinator.scene.noise`), the second linearly.
    """

    depth: float
    lateral: float
    distance: float = 0.0  # metres; 0 if the noise does not depend on the distance

    def at(self, distance: float, floor_m: float) -> SensorNoise:
        """The noise at another distance, metres, in steps of a tenth: most frames have the same settings.

        A part of it, the floor, is the same at all distances.
        """
        if not (self.distance > 0.0 and distance > 0.0):
            return self
        step = 0.1
        share = math.exp(step * round(math.log(distance / self.distance) / step))
        depth = min(self.depth, floor_m) + max(0.0, self.depth - floor_m) * share * share
        return SensorNoise(depth, self.lateral * share, self.distance * share)


NO_NOISE = SensorNoise(0.0, 0.0)


def measure_noise(frame: DepthFrame, settings: NoiseSettings) -> SensorNoise:
    """The noise of a frame that is not empty, at the median distance of its pixels.

    Rounding is part of the noise. Errors that are common to neighbouring pixels are not measured.
    """
    depth_m = frame.metres()
    distance = float(np.median(depth_m[depth_m > 0.0]))
    metres_a_pixel = distance / frame.intrinsics.fx
    noise = fit_noise(depth_m, settings)
    deviation = float(noise.sigma(np.array(distance))) if noise.growth > settings.min_growth_m else 0.0
    lateral_px = outline_deviation(depth_m > 0.0, settings.outline_blur_px)
    return SensorNoise(deviation, lateral_px * metres_a_pixel, distance)


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

    The noise across is at most the noise along: a rougher outline has other reasons.
    """
    depth = max(settings.noise_depth, noise.depth)
    lateral = min(max(settings.noise_lateral, noise.lateral), depth)
    return msgspec.structs.replace(settings, noise_depth=depth, noise_lateral=lateral)
