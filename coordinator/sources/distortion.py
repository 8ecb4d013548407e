"""Lens distortion undone: a depth image as a pinhole camera would have seen it.

The model is OpenCV's rational one (Brown-Conrady with six radial terms). Depth is taken from the nearest
pixel, never mixed, since a mean of near and far lies where nothing is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Distortion:
    """Radial terms k1 to k6, and tangential p1, p2; `reach` is the largest radius that they are made for."""

    radial: tuple[float, float, float, float, float, float]
    tangential: tuple[float, float]
    reach: float = np.inf

    def distort(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Where the lens shows what a pinhole camera sees at (x, y) on the plane z = 1; NaN out of reach."""
        k1, k2, k3, k4, k5, k6 = self.radial
        p1, p2 = self.tangential
        r2 = x * x + y * y
        above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
        scale = np.where(r2 <= self.reach**2, above / below, np.nan)
        return (
            x * scale + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * scale + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )


class Undistortion:
    """The pixels of a lens that belong to each pixel of the pinhole camera with the same matrix."""

    def __init__(self, camera: Intrinsics, distortion: Distortion) -> None:
        v, u = np.indices((camera.height, camera.width), dtype=np.float64)
        x, y = distortion.distort((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
        columns, rows = np.rint(x * camera.fx + camera.cx), np.rint(y * camera.fy + camera.cy)
        self._seen = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
        self._from = np.where(self._seen, rows * camera.width + columns, 0.0).astype(np.int64)

    def __call__(self, depth: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """A depth image (H, W); 0 where the lens saw nothing."""
        return np.where(self._seen, depth.ravel()[self._from], 0).astype(np.uint16)
