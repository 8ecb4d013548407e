"""The subject's pixels in a depth frame: nothing else within 80 cm of it is assumed (section 6)."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from common.camera import project
from common.frame import DepthFrame, SubjectFrame

Array = NDArray[np.float64]
Window = tuple[int, int, int, int]

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
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    if around is not None:
        across = np.ascontiguousarray(around.T)  # numpy is slow along short rows
        low, high = across.min(axis=1) - CLEARANCE, across.max(axis=1) + CLEARANCE
    window, camera = find_window(frame, low, high), frame.intrinsics
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    kept = np.zeros(frame.depth.shape, dtype=np.uint16)
    left, top, right, bottom = keep_within(
        frame.depth, np.float32(frame.depth_scale), lens, low, high, window, kept
    )
    if left >= right:
        return None
    depth = np.ascontiguousarray(kept[top:bottom, left:right])
    height, width = frame.depth.shape
    return SubjectFrame(
        frame=DepthFrame(
            frame.number,
            frame.time_s,
            depth,
            frame.depth_scale,
            camera.crop(left, top, right - left, bottom - top),
        ),
        picked=pick(depth, points),
        view=(-left, -top, width - left, height - top),
    )


def find_window(frame: DepthFrame, low: Array, high: Array) -> Window:
    """Left, top, right and bottom of the pixels in which a box from low (3,) to high (3,) can be seen."""
    height, width = frame.depth.shape
    if not low[2] > 0.0:
        return 0, 0, width, height
    corners = np.array(
        [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    seen = project(corners, frame.intrinsics)
    left, top = np.maximum(0, np.floor(seen.min(axis=0)).astype(int))
    right, bottom = np.minimum((width, height), np.ceil(seen.max(axis=0)).astype(int) + 1)
    return int(left), int(top), max(int(left), int(right)), max(int(top), int(bottom))


def pick(depth: NDArray[np.uint16], points: int) -> NDArray[np.uint32]:
    """Flat indices, ascending, of at most `points` pixels with depth, evenly spread over them."""
    measured = np.flatnonzero(depth)
    if len(measured) > points:
        measured = measured[np.arange(points) * len(measured) // points]
    return measured.astype(np.uint32)


@numba.njit(cache=True, nogil=True)
def keep_within(
    depth: NDArray[np.uint16],
    scale: np.float32,
    lens: tuple[float, float, float, float],
    low: Array,
    high: Array,
    window: Window,
    kept: NDArray[np.uint16],
) -> Window:
    """Copy to kept (H, W) the pixels of a window whose point lies in the box from low (3,) to high (3,).

    Gives left, top, right and bottom of what was kept.
    """
    fx, fy, cx, cy = lens
    left, top, right, bottom = depth.shape[1], depth.shape[0], 0, 0
    across = (np.arange(depth.shape[1]) - cx) / fx
    for v in range(window[1], window[3]):
        down = (v - cy) / fy
        for u in range(window[0], window[2]):
            if depth[v, u] > 0:
                z = np.float32(depth[v, u]) / scale
                x, y = across[u] * z, down * z
                if low[2] <= z <= high[2] and low[0] <= x <= high[0] and low[1] <= y <= high[1]:
                    kept[v, u] = depth[v, u]
                    left, right = min(left, u), max(right, u + 1)
                    top, bottom = min(top, v), max(bottom, v + 1)
    return left, top, right, bottom
