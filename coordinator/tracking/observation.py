"""The subject's pixels of a depth frame, and its observed points (section 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.frame import SUBJECT, DepthFrame, SubjectFrame
from coordinator.filters.belief import USUAL_INTERVAL, Observation
from coordinator.scene.segmentation import Segmentation, Window

Array = NDArray[np.float64]
POINTS = 300  # observed points for the filter
DIGITS = 4  # decimals of an interval in seconds


def isolate(frame: DepthFrame, points: int) -> SubjectFrame | None:
    """Crop a frame that shows only the subject to the pixels with depth; None if there are none.

    At most `points` pixels are picked, evenly distributed.
    """
    rows, columns = (np.flatnonzero(frame.depth.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    return crop(frame, (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1), None, points)


def subject_of(frame: DepthFrame, segmentation: Segmentation, points: int) -> SubjectFrame | None:
    """The crop of a segmented frame with the labels of its pixels; None without a subject."""
    if not (segmentation.labels == SUBJECT).any():
        return None
    return crop(frame, segmentation.window, segmentation.labels, points)


def crop(frame: DepthFrame, window: Window, labels: NDArray[np.uint8] | None, points: int) -> SubjectFrame:
    """A window of a frame with only the subject's depth; with all depth if there are no labels (H, W)."""
    left, top, right, bottom = window
    camera = frame.intrinsics
    depth = np.ascontiguousarray(frame.depth[top:bottom, left:right])
    if labels is not None:
        depth = np.where(labels == SUBJECT, depth, np.uint16(0))
    measured = np.flatnonzero(depth).astype(np.uint32)
    picked = min(len(measured), points)
    return SubjectFrame(
        frame=DepthFrame(
            frame.number,
            frame.time_s,
            depth,
            frame.depth_scale,
            camera.crop(left, top, right - left, bottom - top),
        ),
        picked=measured[np.arange(picked) * len(measured) // max(1, picked)],
        view=(-left, -top, camera.width - left, camera.height - top),
        kinds=labels,
    )


def filter_observation(
    subject: SubjectFrame, last_time_s: float | None, step: Array | None = None
) -> Observation:
    """The observation of a frame; with the usual interval if its time is not after the last one.

    `step` (D,) is the motion since the last frame by encoders. Intervals are rounded to 0.1 ms, so that
    rounded times in files give the same results.
    """
    since = 0.0 if last_time_s is None else round(subject.frame.time_s - last_time_s, DIGITS)
    return Observation(some_points(subject), since if since > 0.0 else USUAL_INTERVAL, step)


def observed_points(subject: SubjectFrame, most: int | None = None) -> Array:
    """The observed points (P, 3), camera frame, metres; if `most` is given, about so many of them."""
    frame, camera = subject.frame, subject.frame.intrinsics
    picked = subject.picked if most is None else subject.picked[:: max(1, len(subject.picked) // most)]
    rows, columns = np.divmod(picked, np.uint32(frame.depth.shape[1]))
    z = frame.depth.ravel()[picked] / frame.depth_scale
    return np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=1)


def some_points(subject: SubjectFrame) -> Array:
    """About POINTS of the observed points (P, 3), camera frame, metres."""
    return observed_points(subject, POINTS)


def middle_of(subject: SubjectFrame) -> Array:
    """Median (3,) of some of the observed points, camera frame, metres."""
    middle: Array = np.median(some_points(subject), axis=0)
    return middle


def distance_of(subject: SubjectFrame) -> float:
    """Median depth of some of the observed points, metres; 0 if there are none."""
    return float(middle_of(subject)[2]) if len(subject.picked) else 0.0
