"""What the filter is given of a frame: a few observed points, and how long ago the last frame was."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.frame import SubjectFrame
from coordinator.filters.sighting import USUAL_INTERVAL, Sighting

POINTS = 300
DIGITS = 4  # of an interval in seconds


def see(
    subject: SubjectFrame, last_time_s: float | None, step: NDArray[np.float64] | None = None
) -> Sighting:
    """The sighting of a frame; at the usual interval where its time is not after the last one's.

    `step` (D,) is what encoders say of the motion since then. Intervals are whole tenths of a millisecond:
    how a file rounds its times is to change nothing.
    """
    since = 0.0 if last_time_s is None else round(subject.frame.time_s - last_time_s, DIGITS)
    return Sighting(some_points(subject), since if since > 0.0 else USUAL_INTERVAL, step)


def some_points(subject: SubjectFrame) -> NDArray[np.float64]:
    """About POINTS of the observed points (P, 3), evenly spread over them, camera frame, metres."""
    frame, camera = subject.frame, subject.frame.intrinsics
    pixels = subject.picked[:: max(1, len(subject.picked) // POINTS)].astype(np.int64)
    rows, columns = np.divmod(pixels, frame.depth.shape[1])
    z = frame.depth.ravel()[pixels] / frame.depth_scale
    return np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=1)


def distance_of(subject: SubjectFrame) -> float:
    """Median depth of some of the observed points, metres; 0 without any."""
    points = some_points(subject)
    return float(np.median(points[:, 2])) if len(points) else 0.0
