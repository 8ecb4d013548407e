"""Colour of a camera beside the depth camera, registered to depth: a colour for each pixel with depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics, moved, points_of
from gepf.coordinator.sources.lens import Lens


@dataclass(frozen=True, eq=False)
class ColourCamera:
    """A colour camera with its distortion, and T_colour_depth (4, 4) from the depth camera's frame, metres.

    Where something hides a surface from the colour camera only, the surface gets the colour of that thing.
    """

    lens: Lens
    T_colour_depth: Array

    def register(
        self, colours: NDArray[np.uint8], depth_m: NDArray[np.floating], camera: Intrinsics
    ) -> NDArray[np.uint8]:
        """Colours (H, W, 3) of the pixels of a depth image (H, W) without distortion; black where none is."""
        there = depth_m > 0
        points = moved(points_of(depth_m, camera, there), self.T_colour_depth)
        ahead = points[:, 2] > 0
        x, y = (points[:, :2] / np.where(ahead, points[:, 2], 1.0)[:, None]).T
        columns, rows = self.lens.pixels_of(x, y)
        height, width = colours.shape[:2]
        seen = ahead & (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        found = np.zeros((len(points), 3), np.uint8)
        found[seen] = colours[rows[seen], columns[seen]]
        registered = np.zeros((*depth_m.shape, 3), np.uint8)
        registered[there] = found
        return registered
