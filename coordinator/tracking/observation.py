"""What a frame shows of a subject: pixels, observed points (Grest and Krueger, 2007, section 6), and joints.

A person may be truncated by the border of the image, or by a table in front of them. What is not in view is
not evidence, either for a pose or against it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Mask
from gepf.common.body import BodyModel
from gepf.common.camera import pixels_at
from gepf.common.frame import HIDDEN, SUBJECT, Frame, SubjectFrame, SubjectView, View
from gepf.common.kinematics import joint_positions
from gepf.coordinator.filters.belief import USUAL_INTERVAL, Observation
from gepf.coordinator.scene.occupancy import Window
from gepf.coordinator.scene.segmentation import Labels, slices

SAMPLED_POINTS = 300  # observed points that are enough for the filter, and for a median
MIN_WEIGHTED_POINTS = 1_000  # low weights never reduce the number of a body's points below this


class MaskedView(NamedTuple):
    """The part of an image that shows a subject.

    labels: (H, W) of the pixels of the window; None: those with depth are the subject, all else is empty.
    weights: (H, W) of these pixels as observed points; None if they are all the same.
    """

    image: View
    window: Window
    labels: Labels | None
    weights: NDArray[np.float32] | None = None


def isolate(frame: Frame, points: int) -> SubjectFrame | None:
    """Crop a frame that shows only the subject to the pixels with depth; None if there are none."""
    views = [masked for view in frame.views if (masked := whole_view(view)) is not None]
    return subject_of(frame, views, points)


def whole_view(view: View) -> MaskedView | None:
    """All pixels of an image that have depth; None if there are none."""
    rows, columns = (np.flatnonzero(view.depth.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return None
    window = int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
    return MaskedView(view, window, None)


def subject_of(frame: Frame, views: Sequence[MaskedView], points: int) -> SubjectFrame | None:
    """The crops of those images of a frame that show the subject; None if no image does.

    At most `points` pixels are picked. The number picked in an image is proportional to the area of the
    subject that it shows. They are evenly distributed there, with a density proportional to their weights.
    """
    depths = [depth_in(view) for view in views]
    areas = [area_of(view.image, depth) for view, depth in zip(views, depths, strict=True)]
    total = sum(areas)
    by_area = sorted(zip(areas, views, depths, strict=True), key=lambda group: -group[0])
    crops = [crop(frame, view, depth, round(points * m2 / total)) for m2, view, depth in by_area if m2 > 0.0]
    return SubjectFrame(frame.number, frame.time_s, tuple(crops)) if crops else None


def depth_in(masked: MaskedView) -> NDArray[np.uint16]:
    """The subject's depth in the window; all depth if there are no labels."""
    depth, labels = masked.image.depth[slices(masked.window)], masked.labels
    return np.ascontiguousarray(depth if labels is None else np.where(labels == SUBJECT, depth, np.uint16(0)))


def area_of(view: View, depth: NDArray[np.uint16]) -> float:
    """The area in square metres, across the line of sight, of the pixels with depth (H, W)."""
    squares = float(np.sum(depth[depth > 0].astype(np.float64) ** 2)) / view.depth_scale**2
    return squares / (view.intrinsics.fx * view.intrinsics.fy)


def crop(frame: Frame, masked: MaskedView, depth: NDArray[np.uint16], max_points: int) -> SubjectView:
    """The crop of one image, with depth and labels (H, W); up to `max_points` pixels are picked."""
    image, (left, top, right, bottom), labels, weights = masked
    camera = image.intrinsics
    window = camera.crop(left, top, right - left, bottom - top)
    return SubjectView(
        image=replace(image, depth=depth, intrinsics=window, colours=None),
        picked=pick(np.flatnonzero(depth).astype(np.uint32), max_points, weights),
        extent=(-left, -top, camera.width - left, camera.height - top),
        labels=labels,
        delay_s=image.time_s - frame.time_s,
    )


def pick(
    measured: NDArray[np.uint32], max_points: int, weights: NDArray[np.float32] | None
) -> NDArray[np.uint32]:
    """At most `max_points` of the measured pixels (N,), flat indices.

    They are evenly distributed, with a density proportional to their weights (H, W). A pixel is picked at
    most once, so fewer are picked if few have large weights. If there are at most MIN_WEIGHTED_POINTS pixels,
    weights do not matter.
    """
    count = min(len(measured), max_points)
    if weights is None or len(measured) <= MIN_WEIGHTED_POINTS:
        return measured[np.arange(count) * len(measured) // max(1, count)]
    total = np.cumsum(weights.ravel()[measured], dtype=np.float64)
    count = min(count, max(int(total[-1] / weights.ravel()[measured].max()), MIN_WEIGHTED_POINTS))
    ranks = np.floor(total / total[-1] * count + 1e-9)
    chosen: NDArray[np.uint32] = measured[np.diff(ranks, prepend=0.0) > 0.0]
    return chosen


def filter_observation(
    subject: SubjectFrame, last_time_s: float | None, step: Array | None = None, unseen: Mask | None = None
) -> Observation:
    """The observation of a frame; with the usual interval if it is not later than the last frame.

    `step` (D,) is the motion since the last frame, from encoders or colour; `unseen` (D,) are degrees of
    freedom that move only joints out of view. Intervals are rounded to 0.1 ms, so that rounded times in files
    give the same results.
    """
    since = 0.0 if last_time_s is None else round(subject.time_s - last_time_s, 4)
    interval = since if since > 0.0 else USUAL_INTERVAL
    return Observation(observed_points(subject, SAMPLED_POINTS), interval, step, len(subject.views), unseen)


def camera_points(view: SubjectView, stride: int = 1) -> Array:
    """Every `stride`-th observed point (P, 3) of one camera, in its own frame, metres."""
    image, camera = view.image, view.image.intrinsics
    picked = view.picked[::stride]
    rows, columns = np.divmod(picked, np.uint32(image.depth.shape[1]))
    z = image.depth.ravel()[picked] / image.depth_scale
    return np.stack([(columns - camera.cx) / camera.fx * z, (rows - camera.cy) / camera.fy * z, z], axis=1)


def observed_points(subject: SubjectFrame, max_points: int | None = None) -> Array:
    """The observed points (P, 3) of all cameras, metres; about `max_points` of them, if that is given."""
    count = sum(len(view.picked) for view in subject.views)
    stride = 1 if max_points is None else max(1, count // max_points)
    return np.concatenate([view.image.to_rig(camera_points(view, stride)) for view in subject.views])


def median_point(subject: SubjectFrame) -> Array:
    """Median (3,) of a sample of the observed points, rig frame, metres."""
    return np.asarray(np.median(observed_points(subject, SAMPLED_POINTS), axis=0))


def in_view(subject: SubjectFrame, points: Array) -> Mask:
    """Which points (..., 3), metres in the rig frame, are in the field of view of at least one camera."""
    flat = points.reshape(-1, 3)
    shown = [shows(view, view.image.to_camera(flat)) for view in subject.views]
    return np.asarray(np.any(shown, axis=0)).reshape(points.shape[:-1])


def shows(view: SubjectView, points: Array) -> Mask:
    """Which points (N, 3) of a camera's frame are in its image and not behind something nearer."""
    shown = np.zeros(len(points), dtype=np.bool_)
    ahead = np.flatnonzero(points[:, 2] > 0.0)
    row, column, inside = pixels_at(points[ahead], view.image.intrinsics)
    left, top, right, bottom = view.extent
    free = (left <= column) & (column < right) & (top <= row) & (row < bottom)
    if view.labels is not None:
        free[inside] &= view.labels[row[inside], column[inside]] != HIDDEN
    shown[ahead] = free
    return shown


@lru_cache(maxsize=16)
def moved_joints(model: BodyModel) -> Mask:
    """Which joints (D, J) each degree of freedom moves; the last joint of its chain if it moves none."""
    count = len(model.dof_names)
    bent = np.full(count, 0.3)  # a straight limb hides that a twist moves its end
    off = joint_positions(model, bent + 0.1 * np.eye(count)) - joint_positions(model, bent[None])
    moves = np.linalg.norm(off, axis=-1) > 1e-9
    for dof in range(count):
        above = dof
        while not moves[dof].any() and above >= 0:
            moves[dof] = model.link_dofs[model.joint_links] == above
            above = int(model.parents[above])
    return np.asarray(moves)


def unseen_dofs(model: BodyModel, seen: Mask) -> Mask:
    """Which degrees of freedom (D,) move only joints that are out of view; `seen` (J,) are in view."""
    return np.asarray(~(moved_joints(model) & seen).any(axis=1))


def thin(subject: SubjectFrame, points: int) -> SubjectFrame:
    """The frame with at most this number of its points, evenly distributed."""
    stride = -(-sum(len(view.picked) for view in subject.views) // points)
    views = (replace(view, picked=view.picked[::stride].copy()) for view in subject.views)
    return replace(subject, views=tuple(views))


def depth_of(subject: SubjectFrame, camera: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """The subject's depth in a camera's full image (H, W), metres, 0 elsewhere; all 0 if its size differs."""
    whole = np.zeros(shape, dtype=np.float32)
    for view in subject.views:
        left, top, right, bottom = view.extent
        if view.image.camera == camera and shape == (bottom - top, right - left):
            rows, columns = np.nonzero(view.image.depth)
            whole[rows - top, columns - left] = view.image.metres()[rows, columns]
    return whole
