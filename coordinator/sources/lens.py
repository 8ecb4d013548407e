"""Lens distortion, which is removed from images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices
from gepf.common.camera import Intrinsics

Value = TypeVar("Value", bound=np.generic)


@dataclass(frozen=True)
class Lens:
    """A pinhole camera and its distortion by the rational model of Brown and Conrady.

    Args:
        camera: The camera after the distortion is removed: of the same size, focal lengths and centre.
        coefficients: k1, k2, p1, p2, k3 and, if not zero, k4, k5, k6, in the order of OpenCV.
        radius: Radius of the field of view, in units of the focal length; 0 for the whole image.
    """

    camera: Intrinsics
    coefficients: Sequence[float] = ()
    radius: float = 0.0

    @cached_property
    def pixels(self) -> Indices:
        """Flat index (H, W) of the distorted pixel for each pixel of the pinhole camera; -1 for none."""
        camera = self.camera
        v, u = np.indices((camera.height, camera.width), dtype=np.float64)
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        columns, rows = self.pixels_of(x, y)
        seen = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
        if self.radius:
            seen &= x * x + y * y <= self.radius**2
        return np.where(seen, rows * camera.width + columns, -1)

    def pixels_of(self, x: Array, y: Array) -> tuple[Indices, Indices]:
        """Columns and rows of the distorted pixels of directions x, y (any shape), in units of depth."""
        camera = self.camera
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.coefficients, *[0.0] * (8 - len(self.coefficients)))
        r2 = x * x + y * y
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        across = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
        down = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
        columns, rows = across * camera.fx + camera.cx, down * camera.fy + camera.cy
        farthest = 2 * max(camera.width, camera.height)  # integers of any size are outside
        return (
            np.rint(np.clip(columns, -1, farthest)).astype(np.int64),
            np.rint(np.clip(rows, -1, farthest)).astype(np.int64),
        )

    def undistort(self, image: NDArray[Value]) -> NDArray[Value]:
        """The undistorted image (H, W) or (H, W, 3); 0 for pixels outside the distorted image."""
        if not any(self.coefficients):
            return image
        flat = image.reshape(-1, *image.shape[2:])[self.pixels]
        flat[self.pixels < 0] = 0
        return flat
