"""Where a body has to stand for a camera to see it whole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics

Array = NDArray[np.float64]

FILLS = 0.85  # of the image
NEAREST_M = 0.8


def fit_in_view(points: Array, camera: Intrinsics) -> Array:
    """Shift (3,) that brings points (n, 3) into the middle of the image, as near as they fit."""
    low, high = points.min(axis=0), points.max(axis=0)
    wide = np.max((high - low)[:2] / (camera.width / camera.fx, camera.height / camera.fy))
    front = max(NEAREST_M, float(wide) / FILLS)
    middle: Array = np.array([*(0.5 * (low + high)[:2]), low[2] - front])
    return -middle
