"""Checks that values are within the bounds; they raise ProtocolError."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gepf.common.bounds import LARGEST, MAX_PIXELS, SMALLEST
from gepf.common.camera import Intrinsics
from gepf.common.errors import ProtocolError


@lru_cache(maxsize=64)
def check_camera(camera: Intrinsics, depth_scale: float) -> None:
    """ProtocolError if a frame cannot have this camera or this scale."""
    if camera.width < 1 or camera.height < 1 or camera.width * camera.height > MAX_PIXELS:
        raise ProtocolError(f"a frame has 1 to {MAX_PIXELS} pixels, not {camera.width} by {camera.height}")
    check_range("the depth scale", depth_scale, SMALLEST, LARGEST)
    check_range("the focal lengths", np.array([camera.fx, camera.fy]), SMALLEST, LARGEST)
    check_range("the camera's centre", np.array([camera.cx, camera.cy]), -LARGEST, LARGEST)


def check_range(what: str, values: NDArray[Any] | float, least: float, most: float) -> None:
    """ProtocolError if a value is NaN or not between two bounds."""
    array = np.asarray(values)
    if array.size == 0:
        return
    low, high = array.min(), array.max()
    if not (low >= least and high <= most):
        shown = f"{low:.10g}" if low == high else f"{low:.10g} to {high:.10g}"
        raise ProtocolError(f"{what} must be {least:.10g} to {most:.10g}, not {shown}")
