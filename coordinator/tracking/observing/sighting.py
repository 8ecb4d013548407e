"""What the filter is given of a frame: a few observed points, and how long ago the last frame was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.frame import SubjectFrame
from coordinator.filters.belief import USUAL_INTERVAL, Observation

POINTS = 300
DIGITS = 4  # of an interval in seconds


def see(
    subject: SubjectFrame, last_time_s: float | None, step: NDArray[np.float64] | None = None
) -> Observation:
    """The sighting of a frame; at the usual interval where its time is not after the last one's.

    `step` (D,) is what encoders say of the motion since then. Intervals are whole tenths of a millisecond:
    how a file rounds its times is to change nothing.
    """
    since = 0.0 if last_time_s is None else round(subject.frame.time_s - last_time_s, DIGITS)
    return Observation(some_points(subject), since if since > 0.0 else USUAL_INTERVAL, step)


def some_points(subject: SubjectFrame) -> NDArray[np.float64]:
    """About POINTS of the observed points (P, 3), evenly spread over them, camera frame, metres."""
    frame, camera = subject.frame, subject.frame.intrinsics
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    every = max(1, len(subject.picked) // POINTS)
    points = np.empty((len(range(0, len(subject.picked), every)), 3))
    place_some(frame.depth, float(frame.depth_scale), lens, subject.picked, every, points)
    return points


def distance_of(subject: SubjectFrame) -> float:
    """Median depth of some of the observed points, metres; 0 without any."""
    return median_depth(some_points(subject))


@numba.njit(cache=True, nogil=True)
def place_some(
    depth: NDArray[np.uint16],
    scale: float,
    lens: tuple[float, float, float, float],
    picked: NDArray[np.uint32],
    every: int,
    points: NDArray[np.float64],
) -> None:
    """Fill points (P, 3) with each so many-th picked pixel of depth (H, W), by a lens (fx, fy, cx, cy)."""
    fx, fy, cx, cy = lens
    for p in range(len(points)):
        row, column = divmod(np.int64(picked[p * every]), np.int64(depth.shape[1]))
        z = depth[row, column] / scale
        points[p, 0], points[p, 1], points[p, 2] = (column - cx) / fx * z, (row - cy) / fy * z, z


@numba.njit(cache=True, nogil=True)
def median_depth(points: NDArray[np.float64]) -> float:
    """Of points (P, 3), metres; 0 without any."""
    if len(points) == 0:
        return 0.0
    depths = np.sort(points[:, 2])
    middle = len(depths) // 2
    return float(depths[middle] if len(depths) % 2 else (depths[middle - 1] + depths[middle]) / 2.0)
