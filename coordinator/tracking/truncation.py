"""Where a view of a person is truncated: by the border of the image, or by something nearer."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.camera import points_of
from gepf.common.frame import EMPTY, HIDDEN, SUBJECT, SubjectView
from gepf.coordinator.settings import SearchSettings

DIRECTIONS = ((-1, 0), (1, 0), (0, -1), (0, 1))
"""Columns and rows of a step to the left, right, top and bottom of an image."""
TOP = 2  # index of the top in DIRECTIONS


def truncated_sides(view: SubjectView, turn: Array, settings: SearchSettings) -> Mask:
    """Where one camera's view of a person ends before the person does: (left, right, top, bottom).

    The sides are those of the image after a rotation by `turn` (3, 3). A side is truncated if most of the
    person's outermost pixels on that side touch the border of the image or something nearer.
    """
    depth = view.image.metres()
    mask = depth > 0.0
    truncated = np.zeros(4, dtype=np.bool_)
    if not mask.any():
        return truncated
    points = points_of(depth, view.image.intrinsics, mask) @ turn.T
    for side, (across, down) in enumerate(DIRECTIONS):
        # in the original, unrotated image
        step = np.rint((np.array([across, down, 0.0]) @ turn)[:2]).astype(np.int64)
        if np.abs(step).sum() != 1:  # a diagonal belongs to two sides
            continue
        along = points[:, :2] @ (across, down)
        end = np.flatnonzero(along > along.max() - settings.end_m)
        rows, columns = (indices[end] for indices in np.nonzero(mask))
        outer = ends_of(mask, rows, columns, step)
        distance_m = float(np.median(points[end, 2]))
        gap_px = int(settings.cut_gap_m * view.image.intrinsics.fx / distance_m)
        stopped = is_stopped(view, rows[outer], columns[outer], step, gap_px)
        truncated[side] = stopped.mean() >= settings.cut_share
    return truncated


def ends_of(mask: Mask, rows: Indices, columns: Indices, step: Indices) -> Indices:
    """Indices of the person's pixels that are outermost in the direction of a step (columns, rows)."""
    position = rows * step[1] + columns * step[0]
    line = columns if step[1] else rows
    last = np.full(max(mask.shape), np.iinfo(np.int64).min)
    np.maximum.at(last, line, position)
    return np.flatnonzero(position == last[line])


def is_stopped(view: SubjectView, rows: Indices, columns: Indices, step: Indices, gap_px: int) -> Mask:
    """Whether the first conclusive pixel beyond each pixel is outside the image, or shows something nearer.

    Unknown and unmeasured pixels are not conclusive.
    """
    left, top, right, bottom = view.extent
    height, width = view.image.depth.shape
    stopped, undecided = np.zeros(len(rows), dtype=np.bool_), np.ones(len(rows), dtype=np.bool_)
    for n in range(1, 2 + gap_px):
        row, column = rows + n * step[1], columns + n * step[0]
        outside = (column < left) | (column >= right) | (row < top) | (row >= bottom)
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        label = np.full(len(rows), EMPTY)
        if view.labels is not None:
            label[inside] = view.labels[row[inside], column[inside]]
        stopped |= undecided & (outside | (label == HIDDEN))
        undecided &= ~(outside | (label == HIDDEN) | (label == EMPTY) | (label == SUBJECT))
    return stopped
