"""The part of the image that a picture shows, and at what size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.camera import Intrinsics, project
from coordinator.results.track import Track

Image = NDArray[np.float32]

SMALLEST = 2  # pixels of a window's side
MARGIN_M = 0.25  # around the joints: half a torso, a hand, the top of the head


@dataclass(frozen=True, slots=True)
class View:
    """A window of a camera's image, `scale` picture pixels for one of the image's."""

    camera: Intrinsics  # of the whole image
    left: int
    top: int
    columns: int
    rows: int
    scale: float

    @property
    def width(self) -> int:
        """Of the picture, pixels."""
        return max(1, round(self.columns * self.scale))

    @property
    def height(self) -> int:
        """Of the picture, pixels."""
        return max(1, round(self.rows * self.scale))

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera whose image is the picture."""
        s, whole = self.scale, self.camera
        cx, cy = ((c + 0.5) * s - 0.5 for c in (whole.cx - self.left, whole.cy - self.top))
        return Intrinsics(self.width, self.height, whole.fx * s, whole.fy * s, cx, cy)

    @property
    def window(self) -> Intrinsics:
        """The camera whose image is the window, at the image's own size."""
        return self.camera.crop(self.left, self.top, self.columns, self.rows)

    def crop(self, image: Image) -> Image:
        """The window (rows, columns) of an image (H, W)."""
        return image[self.top : self.top + self.rows, self.left : self.left + self.columns]

    def resized(self, factor: float) -> View:
        """The same window at another size."""
        return View(self.camera, self.left, self.top, self.columns, self.rows, self.scale * factor)


def around(track: Track, camera: Intrinsics, width: int, height: int) -> View:
    """The view that shows all joints of all frames, and fits into width x height pixels.

    Where a lost body is said to be does not count, unless it is lost all the time.
    """
    kept = ~track.unknown
    points = track.joint_positions[kept if kept.any() else ...].reshape(-1, 3)
    points = points[np.all(np.isfinite(points), axis=1) & (points[:, 2] > MARGIN_M)]
    if not len(points):
        return fit(camera, 0, 0, camera.width, camera.height, width, height)
    pixels, reach = project(points, camera), camera.fx * MARGIN_M / points[:, 2:]
    last = np.array([camera.width, camera.height])
    low = np.clip(np.floor((pixels - reach).min(axis=0)), 0, last - SMALLEST).astype(int)
    high = np.clip(np.ceil((pixels + reach).max(axis=0)), low + SMALLEST, last).astype(int)
    columns, rows = high - low
    return fit(camera, int(low[0]), int(low[1]), int(columns), int(rows), width, height)


def fit(camera: Intrinsics, left: int, top: int, columns: int, rows: int, width: int, height: int) -> View:
    """A window at the largest size within width x height."""
    return View(camera, left, top, columns, rows, min(width / columns, height / rows))
