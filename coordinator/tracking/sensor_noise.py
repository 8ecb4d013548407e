"""How noisy a camera is, measured in one of its depth images."""

from __future__ import annotations

import math
from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from common.frame import DepthFrame
from common.settings import RefineSettings
from coordinator.scene.noise import GROWTH, LEAST, fit_noise, sigma

STEP = 0.1  # of the logarithm of a distance
OUTLINE_BLUR = 4.0  # pixels over which an outline is averaged until it no longer frays


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviations of a measured point along the line of sight and across it, metres, at a distance.

    Along it grows with the square of the distance (`coordinator.scene.noise`), across it with the distance.
    """

    depth: float = 0.0
    lateral: float = 0.0
    distance: float = 0.0  # metres; 0 where the noise is the same at any

    def at(self, distance: float) -> SensorNoise:
        """The noise at another distance, metres, in steps of a tenth: most frames are refined by the same."""
        if not (self.distance > 0.0 and distance > 0.0):
            return self
        share = math.exp(STEP * round(math.log(distance / self.distance) / STEP))
        depth = min(self.depth, LEAST) + max(0.0, self.depth - LEAST) * share * share
        return SensorNoise(depth, self.lateral * share, self.distance * share)


def measure_noise(frame: DepthFrame) -> SensorNoise:
    """The noise of a frame that shows at least something, at the median distance of what it shows.

    Rounding counts as noise; what neighbouring pixels share does not show in one frame.
    """
    depth_m = frame.metres()
    distance = float(np.median(depth_m[depth_m > 0.0]))
    metres_a_pixel = distance / frame.intrinsics.fx
    growth = fit_noise(depth_m)
    deviation = float(sigma(np.array(distance), growth)) if growth > GROWTH[0] else 0.0
    return SensorNoise(deviation, outline_deviation(depth_m > 0.0) * metres_a_pixel, distance)


def outline_deviation(mask: NDArray[np.bool_]) -> float:
    """Standard deviation in pixels of what displaces the pixels of a silhouette (H, W), each by itself.

    Across a straight outline a pixel at distance x is inside with probability Phi(x / s), so neighbours
    differ 2 s / sqrt(pi) times in each row that crosses it; without noise, once. Summed over rows and
    columns the outline's direction cancels, and the ratio to a smooth outline is sqrt(pi) s.
    """
    padded = np.pad(mask, int(4 * OUTLINE_BLUR)).astype(np.float64)
    smooth = count_changes(gaussian_filter(padded, OUTLINE_BLUR) > 0.5)
    frayed = count_changes(padded > 0.5)
    return frayed / smooth / math.sqrt(math.pi) if smooth else 0.0


def count_changes(mask: NDArray[np.bool_]) -> int:
    """Pairs of neighbours, of which one is inside."""
    return int(np.sum(mask[:, 1:] != mask[:, :-1]) + np.sum(mask[1:] != mask[:-1]))


def assume_noise(settings: RefineSettings, noise: SensorNoise) -> RefineSettings:
    """Settings that assume at least this noise. What they assume already is the worth of the surface's fit.

    No camera is worse across than along: a ragged outline has other reasons then.
    """
    depth = max(settings.noise_depth, noise.depth)
    lateral = min(max(settings.noise_lateral, noise.lateral), depth)
    return msgspec.structs.replace(settings, noise_depth=depth, noise_lateral=lateral)
