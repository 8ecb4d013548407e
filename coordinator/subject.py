"""The subject's pixels in a depth frame: nothing else within 80 cm of it is assumed (section 6)."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from common.frame import DepthFrame, SubjectFrame

CLEARANCE = 0.8  # metres around the subject in which there is nothing else


def isolate(frame: DepthFrame, around: NDArray[np.float64] | None, points: int) -> SubjectFrame | None:
    """Crop a frame to the subject and pick the pixels that become observed points.

    Args:
        frame: The whole image.
        around: Points (V, 3) in the camera frame near which the subject must be, metres; None for all
            that has depth.
        points: How many pixels to pick at the most, evenly spread.

    Returns:
        The crop, or None where nothing of the subject was measured.
    """
    mask = frame.depth > 0 if around is None else _near(frame, around)
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return None
    top, bottom, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
    depth = np.where(mask, frame.depth, 0)[top:bottom, left:right].astype(np.uint16)
    height, width = frame.depth.shape
    camera = frame.intrinsics.crop(int(left), int(top), int(right - left), int(bottom - top))
    return SubjectFrame(
        frame=DepthFrame(frame.number, frame.time_s, np.ascontiguousarray(depth), frame.depth_scale, camera),
        picked=pick(depth, points),
        view=(-int(left), -int(top), int(width - left), int(height - top)),
    )


def pick(depth: NDArray[np.uint16], points: int) -> NDArray[np.uint32]:
    """Flat indices, ascending, of at most `points` pixels with depth, evenly spread over them."""
    measured = np.flatnonzero(depth)
    if len(measured) > points:
        measured = measured[np.arange(points) * len(measured) // points]
    return measured.astype(np.uint32)


def _near(frame: DepthFrame, around: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which pixels (H, W) with depth lie in the bounding box of points (V, 3) enlarged by the clearance."""
    low, high = around.min(axis=0) - CLEARANCE, around.max(axis=0) + CLEARANCE
    camera = frame.intrinsics
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    near = np.empty(frame.depth.shape, dtype=np.bool_)
    mark_within(frame.depth, np.float32(frame.depth_scale), lens, low, high, near)
    return near


@numba.njit(cache=True, nogil=True)
def mark_within(
    depth: NDArray[np.uint16],
    scale: np.float32,
    lens: tuple[float, float, float, float],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    out: NDArray[np.bool_],
) -> None:
    """Mark the pixels (H, W) that have depth and whose point lies in the box from low (3,) to high (3,)."""
    fx, fy, cx, cy = lens
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            out[v, u] = False
            if depth[v, u] > 0:
                z = np.float32(depth[v, u]) / scale
                x, y = (u - cx) / fx * z, (v - cy) / fy * z
                out[v, u] = low[0] <= x <= high[0] and low[1] <= y <= high[1] and low[2] <= z <= high[2]
