"""What a frame can show of a body: nothing outside the image, and nothing behind something nearer.

A person may be truncated by the border of the image, or by a table in front of them. What is not in view is
not evidence, either for a pose or against it.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.camera import pixels_at, points_of
from gepf.common.frame import EMPTY, HIDDEN, SUBJECT, SubjectFrame, SubjectView
from gepf.common.kinematics import joint_positions
from gepf.coordinator.settings import SearchSettings

DIRECTIONS = ((-1, 0), (1, 0), (0, -1), (0, 1))
"""Columns and rows of a step to the left, right, top and bottom of an image."""
TOP = 2  # index of the top in DIRECTIONS


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
    if view.kinds is not None:
        free[inside] &= view.kinds[row[inside], column[inside]] != HIDDEN
    shown[ahead] = free
    return shown


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
        gap_m, distance_m = settings.cut_gap_m, float(np.median(points[end, 2]))
        gap_px = int(gap_m * view.image.intrinsics.fx / distance_m)
        stopped = is_stopped(view, rows[outer], columns[outer], step, gap_px)
        truncated[side] = stopped.mean() >= settings.cut_share
    return truncated


def ends_of(mask: Mask, rows: Indices, columns: Indices, step: Indices) -> Indices:
    """The person's outermost pixels in the direction of a step (columns, rows)."""
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
    stopped, open_ = np.zeros(len(rows), dtype=np.bool_), np.ones(len(rows), dtype=np.bool_)
    for n in range(1, 2 + gap_px):
        row, column = rows + n * step[1], columns + n * step[0]
        outside = (column < left) | (column >= right) | (row < top) | (row >= bottom)
        inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        label = np.full(len(rows), EMPTY)
        if view.kinds is not None:
            label[inside] = view.kinds[row[inside], column[inside]]
        stopped |= open_ & (outside | (label == HIDDEN))
        open_ &= ~(outside | (label == HIDDEN) | (label == EMPTY) | (label == SUBJECT))
    return stopped


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
