"""Checks that values are within the bounds; they raise ProtocolError."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gepf.common.bounds import LARGEST, MAX_PIXELS, MOST_PIXELS, MOST_WORK, SMALLEST
from gepf.common.camera import Intrinsics
from gepf.common.errors import ProtocolError
from gepf.common.settings import RefineSettings


def check_work(settings: RefineSettings, poses: int, points: int, vertices: int) -> None:
    """ProtocolError if refining this number of poses on this number of points would take too long."""
    each = 2.0 * (points * vertices + MOST_PIXELS)  # with soft correspondences
    work = poses * (1 + settings.icp_iterations) * each
    if work > MOST_WORK:
        raise ProtocolError(f"the request takes up to {work:.0e} steps of work, more than {MOST_WORK:.0e}")


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
