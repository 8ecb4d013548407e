"""Frames of tiny cameras that show a wall."""

from __future__ import annotations

import numpy as np

from gepf.common.camera import Intrinsics
from gepf.common.frame import View

CAMERA = Intrinsics(4, 3, 10.0, 10.0, 2.0, 1.5)
LONG = Intrinsics(4, 3, 11.0, 10.0, 2.0, 1.5)
WIDE = Intrinsics(6, 3, 10.0, 10.0, 3.0, 1.5)


def image(
    number: int,
    time_s: float | None = None,
    camera: Intrinsics = CAMERA,
    depth_scale: float = 1000.0,
    depth: int = 2000,
) -> View:
    """A frame that shows a wall; by default of the camera that all tests begin with."""
    seen = np.full((camera.height, camera.width), depth, dtype=np.uint16)
    return View(number, number / 30 if time_s is None else time_s, seen, depth_scale, camera)
