"""What is taken from a depth frame: the subject's pixels, and those that are observed points (section 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.frame import SUBJECT, DepthFrame, SubjectFrame
from coordinator.filters.belief import USUAL_INTERVAL, Observation
from coordinator.scene.segmentation import Segmentation, Window

Array = NDArray[np.float64]
POINTS = 300  # of the observed ones, which the filter is given
DIGITS = 4  # of an interval in seconds


def isolate(frame: DepthFrame, points: int) -> SubjectFrame | None:
    """A frame that shows nothing but the subject, cropped to what was measured; None where nothing was.

    At most `points` pixels are picked, evenly spread.
    """
    rows, columns = (np.flatnonzero(frame.depth.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    return crop(frame, (int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1), None, points)


def subject_of(frame: DepthFrame, segmentation: Segmentation, points: int) -> SubjectFrame | None:
    """The crop of a frame that was segmented, with its pixels' labels; None without a subject."""
    if not (segmentation.labels == SUBJECT).any():
        return None
    return crop(frame, segmentation.window, segmentation.labels, points)


def crop(frame: DepthFrame, window: Window, labels: NDArray[np.uint8] | None, points: int) -> SubjectFrame:
    """A window of a frame with the subject's depth alone; all of it without labels (H, W)."""
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


def see(subject: SubjectFrame, last_time_s: float | None, step: Array | None = None) -> Observation:
    """What a frame shows; at the usual interval where its time is not after the last one's.

    `step` (D,) is what encoders say of the motion since then. Intervals are whole tenths of a millisecond,
    so that the rounding of times in a file changes nothing.
    """
    since = 0.0 if last_time_s is None else round(subject.frame.time_s - last_time_s, DIGITS)
    return Observation(some_points(subject), since if since > 0.0 else USUAL_INTERVAL, step)


def observed_points(subject: SubjectFrame, most: int | None = None) -> Array:
    """The observed points (P, 3), camera frame, metres; about `most` of them, evenly spread, if given."""
    frame, camera = subject.frame, subject.frame.intrinsics
    picked = subject.picked if most is None else subject.picked[:: max(1, len(subject.picked) // most)]
    rows, columns = np.divmod(picked, np.uint32(frame.depth.shape[1]))
    z = frame.depth.ravel()[picked] / frame.depth_scale
    return np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=1)


def some_points(subject: SubjectFrame) -> Array:
    """About POINTS of the observed points (P, 3), camera frame, metres."""
    return observed_points(subject, POINTS)


def distance_of(subject: SubjectFrame) -> float:
    """Median depth of some of the observed points, metres; 0 without any."""
    return float(np.median(some_points(subject)[:, 2])) if len(subject.picked) else 0.0
