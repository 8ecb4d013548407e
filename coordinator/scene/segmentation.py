"""The pixels of a frame labelled for one body: its own, empty, in front of it, or unknown.

What is near the posed body and no part of the room, and what continues it in depth, is the subject's. Where
several bodies are near each other, a pixel is of the body that is nearest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.camera import back_project
from common.frame import EMPTY, HIDDEN, SUBJECT, UNKNOWN, UNMEASURED
from coordinator.scene.distance_field import DistanceField, squared_cells
from coordinator.scene.geometry import Array, Mask, Window, label_parts
from coordinator.scene.room import FOREGROUND, NOT_MEASURED, ON_PLANE, SceneView, mark_pixels

Labels = NDArray[np.uint8]

REACH_M = 0.28  # from the posed surface to what may be the subject's
CLOSE_M = 0.08  # and to what is, if it is no part of the room
TOUCHING_M = 0.04  # between the posed surface and the room, where the two cannot be told apart
THICKNESS_M = 0.25  # of a person behind what is seen
CLOSEST_M = 0.1  # to the camera's plane
EXPLAINED_M = 0.12  # from the posed surface to what is surely no other person's, and no room's
PRESENT_SHARE = 0.35  # of the posed surface in the frame on the subject's pixels: with less it may have left


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """The labels of a window of the frame.

    window: Left, top, right and bottom. labels: (H, W) of its pixels: SUBJECT; EMPTY, where something farther
    was measured; HIDDEN, where something nearer was; UNMEASURED; UNKNOWN.
    """

    window: Window
    labels: Labels

    def subject(self, shape: tuple[int, ...]) -> Mask:
        """Pixels of the whole frame (H, W) that show the subject."""
        mask = np.zeros(shape, dtype=np.bool_)
        mask[slices(self.window)] = self.labels == SUBJECT
        return mask


def slices(window: Window) -> tuple[slice, slice]:
    """Its rows and columns."""
    left, top, right, bottom = window
    return slice(top, bottom), slice(left, right)


def segment_body(
    view: SceneView,
    surface: Array,
    field: DistanceField | None = None,
    others: Mask | None = None,
    reach: float = REACH_M,
) -> Segmentation:
    """Label the pixels around the points (V, 3) of a posed body, metres.

    Args:
        view: The frame in its scene.
        surface: The points.
        field: Distances from them, if they are known.
        others: Pixels (H, W) that are other people's, or may be: they say nothing of this one.
        reach: Metres from the surface to what may be the subject's.
    """
    window = window_of(view, surface)
    part, background = view.depth[slices(window)], view.background[slices(window)]
    fx, fy, cx, cy = view.lens
    lens = (fx, fy, cx - window[0], cy - window[1])
    marks = np.empty(part.shape, dtype=np.uint8)
    mark_pixels(part, background, lens, view.planes.coefficients, view.noise.growth, marks)
    squares = (field or DistanceField.around(surface)).measure(part, lens)
    unclear = (marks != FOREGROUND) & (marks != NOT_MEASURED) & (squares <= squared_cells(TOUCHING_M))
    for mask in (view.left_out, others):
        if mask is not None:
            unclear |= mask[slices(window)]
    near = (marks == FOREGROUND) & (squares <= squared_cells(reach)) & ~unclear
    parts = label_parts(part, near, view.noise.growth)
    chosen = np.zeros(parts.max(initial=0) + 1, dtype=np.bool_)
    chosen[parts[squares <= squared_cells(CLOSE_M)]] = True
    labels = np.full(part.shape, EMPTY, dtype=np.uint8)
    labels[(marks != ON_PLANE) & (part < surface[:, 2].max())] = HIDDEN
    labels[marks == NOT_MEASURED] = UNMEASURED if view.furnished else EMPTY
    labels[unclear] = UNKNOWN
    labels[near & chosen[parts]] = SUBJECT
    return Segmentation(window, labels)


def segment_mask(view: SceneView, mask: Mask, others: Mask | None = None) -> Segmentation:
    """The same of a person whose pixels (H, W) are known, of whom there is no posed body yet."""
    points = back_project(view.depth, view.camera)[mask]
    behind = points * (1.0 + THICKNESS_M / points[:, 2:])
    found = segment_body(view, np.concatenate([points, behind]), others=others)
    mine = mask[slices(found.window)]
    labels = np.where(found.labels == SUBJECT, np.uint8(UNKNOWN), found.labels)
    labels[mine] = SUBJECT
    return replace(found, labels=labels)


def window_of(view: SceneView, surface: Array) -> Window:
    """The pixels in which something within REACH_M of the points (V, 3) can be seen."""
    width, height = view.camera.width, view.camera.height
    nearest = surface[:, 2] - REACH_M
    if nearest.min() < CLOSEST_M:
        return 0, 0, width, height
    fx, fy, cx, cy = view.lens
    u, v = cx + fx * surface[:, 0] / surface[:, 2], cy + fy * surface[:, 1] / surface[:, 2]
    across, along = REACH_M * fx / nearest, REACH_M * fy / nearest
    left, right = np.clip([(u - across).min(), (u + across).max() + 2.0], 0.0, width).astype(int).tolist()
    top, bottom = np.clip([(v - along).min(), (v + along).max() + 2.0], 0.0, height).astype(int).tolist()
    return left, top, right, bottom


def is_present(view: SceneView, surface: Array, segmentation: Segmentation) -> bool:
    """Whether enough of the points (V, 3) of a posed body fall on pixels that show it."""
    fx, fy, cx, cy = view.lens
    left, top, _, _ = segmentation.window
    x, y, z = surface[surface[:, 2] > CLOSEST_M].T
    u, v = np.rint(cx + fx * x / z).astype(int) - left, np.rint(cy + fy * y / z).astype(int) - top
    rows, columns = segmentation.labels.shape
    inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
    shown = segmentation.labels[v[inside], u[inside]] == SUBJECT
    return bool(np.count_nonzero(shown) > PRESENT_SHARE * len(shown))


def assign_pixels(view: SceneView, fields: Sequence[DistanceField]) -> list[Mask | None]:
    """For each of several bodies the pixels (H, W) nearer to another; None where no other body is near."""
    touching = [any(one.meets(other) for other in fields if other is not one) for one in fields]
    if not any(touching):
        return [None] * len(fields)
    squares = np.array([field.measure(view.depth, view.lens) for field in fields])
    nearest = squares.min(axis=0)
    return [mine > nearest if near else None for mine, near in zip(squares, touching, strict=True)]


def explained(view: SceneView, fields: Sequence[DistanceField]) -> Mask:
    """Pixels (H, W) within EXPLAINED_M of any of several bodies: not learned as the room, and nobody else."""
    near = np.zeros(view.depth.shape, dtype=np.bool_)
    for field in fields:
        near |= field.measure(view.depth, view.lens) <= squared_cells(EXPLAINED_M)
    return near
