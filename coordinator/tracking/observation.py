"""What is taken from a depth frame: the subject's pixels, and those that are observed points (section 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.frame import SUBJECT, DepthFrame, SubjectFrame
from coordinator.filters.belief import USUAL_INTERVAL, Observation
from coordinator.scene.segmentation import Segmentation

Array = NDArray[np.float64]
Window = tuple[int, int, int, int]
Lens = tuple[float, float, float, float]  # fx, fy, cx, cy

CLEARANCE = 0.8  # metres around the subject in which there is nothing else
POINTS = 300  # of the observed ones, which the filter is given
DIGITS = 4  # of an interval in seconds


def isolate(frame: DepthFrame, around: Array | None, points: int) -> SubjectFrame | None:
    """Crop a frame to the subject where nothing else is seen within 80 cm of it.

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
        low, high = around.min(axis=0) - CLEARANCE, around.max(axis=0) + CLEARANCE
    camera = frame.intrinsics
    lens = (camera.fx, camera.fy, camera.cx, camera.cy)
    left, top, right, bottom = find_window(lens, camera.width, camera.height, low, high)
    kept = np.zeros((bottom - top, right - left), dtype=np.uint16)
    first, above, last, below = keep_within(
        frame.depth, np.float32(frame.depth_scale), lens, low, high, left, top, kept
    )
    if first >= last:
        return None
    depth, left, top = np.ascontiguousarray(kept[above:below, first:last]), left + first, top + above
    rows, columns = depth.shape
    return SubjectFrame(
        frame=DepthFrame(
            frame.number, frame.time_s, depth, frame.depth_scale, camera.crop(left, top, columns, rows)
        ),
        picked=pick(depth, points),
        view=(-left, -top, camera.width - left, camera.height - top),
    )


def subject_of(frame: DepthFrame, segmentation: Segmentation, points: int) -> SubjectFrame | None:
    """The crop of a frame that was segmented, with its pixels' labels; None without a subject."""
    left, top, right, bottom = segmentation.window
    mine = segmentation.labels == SUBJECT
    if not mine.any():
        return None
    camera = frame.intrinsics
    depth = np.where(mine, frame.depth[top:bottom, left:right], np.uint16(0))
    return SubjectFrame(
        frame=DepthFrame(
            frame.number,
            frame.time_s,
            depth,
            frame.depth_scale,
            camera.crop(left, top, right - left, bottom - top),
        ),
        picked=pick(depth, points),
        view=(-left, -top, camera.width - left, camera.height - top),
        kinds=segmentation.labels,
    )


def pick(depth: NDArray[np.uint16], points: int) -> NDArray[np.uint32]:
    """Flat indices, ascending, of at most `points` pixels with depth, evenly spread over them."""
    measured = int(np.count_nonzero(depth))
    picked = np.empty(min(measured, points), dtype=np.uint32)
    pick_evenly(depth.ravel(), measured, picked)
    return picked


@numba.njit(cache=True, nogil=True)
def pick_evenly(depth: NDArray[np.uint16], measured: int, picked: NDArray[np.uint32]) -> None:
    """Fill picked (P,) with places in depth, of which so many are measured: each M/P-th of these."""
    place = count = due = 0
    for i in range(len(depth)):
        if depth[i] > 0:
            if count == due and place < len(picked):
                picked[place] = i
                place += 1
                due = place * measured // len(picked)
            count += 1


@numba.njit(cache=True, nogil=True)
def find_window(lens: Lens, width: int, height: int, low: Array, high: Array) -> Window:
    """Left, top, right and bottom of the pixels in which a box from low (3,) to high (3,) can be seen."""
    if not low[2] > 0.0:
        return 0, 0, width, height
    fx, fy, cx, cy = lens
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    for z in (low[2], high[2]):
        left, right = min(left, cx + fx * low[0] / z), max(right, cx + fx * high[0] / z)
        top, bottom = min(top, cy + fy * low[1] / z), max(bottom, cy + fy * high[1] / z)
    first, above = int(min(max(0.0, np.floor(left)), width)), int(min(max(0.0, np.floor(top)), height))
    last, below = int(min(max(-1.0, np.ceil(right)), width)), int(min(max(-1.0, np.ceil(bottom)), height))
    return first, above, max(first, min(last + 1, width)), max(above, min(below + 1, height))


@numba.njit(cache=True, nogil=True)
def keep_within(
    depth: NDArray[np.uint16],
    scale: np.float32,
    lens: Lens,
    low: Array,
    high: Array,
    left_of: int,
    top_of: int,
    kept: NDArray[np.uint16],
) -> Window:
    """Copy to kept (H, W) the pixels of depth whose point lies in the box from low (3,) to high (3,).

    kept begins at column left_of and row top_of of depth. Gives left, top, right and bottom of what was kept.
    """
    fx, fy, cx, cy = lens
    rows, columns = kept.shape
    near, far = max(1, first_from(low[2], scale)), first_from(np.nextafter(high[2], np.inf), scale)
    across = (np.arange(left_of, left_of + columns) - cx) / fx
    left, top, right, bottom = columns, rows, 0, 0
    for v in range(rows):
        line, down = depth[top_of + v, left_of : left_of + columns], (top_of + v - cy) / fy
        for u in range(columns):
            if near <= line[u] < far:
                z = np.float32(line[u]) / scale
                x, y = across[u] * z, down * z
                if low[0] <= x <= high[0] and low[1] <= y <= high[1]:
                    kept[v, u] = line[u]
                    left, right = min(left, u), max(right, u + 1)
                    top, bottom = min(top, v), v + 1
    return left, top, right, bottom


@numba.njit(cache=True, nogil=True)
def first_from(z: float, scale: np.float32) -> int:
    """The least depth value that is z metres or more, of those up to 65 536."""
    value = int(min(max(0.0, z * float(scale) - 2.0), 65_536.0))
    while value < 65_536 and np.float32(value) / scale < z:
        value += 1
    return value


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
