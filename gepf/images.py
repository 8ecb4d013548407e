"""Depth images that come as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from common.errors import InputError
from common.frame import DepthFrame
from coordinator.sources.arrays import whole_depth
from coordinator.sources.camera import DEFAULT_FPS, pinhole


@dataclass(frozen=True, slots=True)
class Images:
    """The camera of arrays: its matrix (3, 3), and units per metre of whole numbers."""

    camera: ArrayLike | None
    depth_scale: float | None

    def frame(self, depth: DepthFrame | ArrayLike, number: int, time_s: float | None) -> DepthFrame:
        """A frame as it is, or an array (H, W) as the frame of this number."""
        if isinstance(depth, DepthFrame):
            return depth
        image = np.asarray(depth)
        if self.camera is None:
            raise InputError("an array comes without its camera; give Tracker(camera=...) its matrix")
        if image.ndim != 2 or 0 in image.shape:
            raise InputError(f"depth has shape {image.shape}; give rows of columns (H, W)")
        units, scale = whole_depth(image, self.depth_scale, "depth")
        camera = pinhole(self.camera, image.shape[1], image.shape[0], "camera")
        when = number / DEFAULT_FPS if time_s is None else time_s
        return DepthFrame(number, when, units, scale, camera)
