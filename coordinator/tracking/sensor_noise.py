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

OUTLINE_BLUR = 4.0  # pixels over which an outline is averaged until it no longer frays
MAD_TO_DEVIATION = 1.4826  # of a Gaussian


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviations of a measured point along the line of sight and across it, metres."""

    depth: float = 0.0
    lateral: float = 0.0


def measure_noise(frame: DepthFrame) -> SensorNoise:
    """The noise of a frame that shows at least something."""
    depth_m = frame.metres().astype(np.float64)
    metres_a_pixel = float(np.median(depth_m[depth_m > 0.0])) / frame.intrinsics.fx
    return SensorNoise(depth_deviation(depth_m), outline_deviation(depth_m > 0.0) * metres_a_pixel)


def depth_deviation(depth_m: NDArray[np.float64]) -> float:
    """Standard deviation in metres of a depth image (H, W), 0 where nothing was measured.

    From the second differences of three pixels in a row, in which surfaces as good as vanish; by their
    median, so that edges do not count. Noise that neighbours share is not seen.
    """
    bends = []
    for image in (depth_m, depth_m.T):
        left, middle, right = image[:, :-2], image[:, 1:-1], image[:, 2:]
        measured = (left > 0.0) & (middle > 0.0) & (right > 0.0)
        bends.append(np.abs(left - 2.0 * middle + right)[measured])
    both = np.concatenate(bends)
    return MAD_TO_DEVIATION * float(np.median(both)) / math.sqrt(6.0) if len(both) else 0.0


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
