"""Labels the pixels of a frame for one body: subject, empty, hidden, unmeasured or unknown.

The subject is the foreground near the posed body, and the foreground connected to it in depth. If several
bodies are near each other, a pixel belongs to the nearest body.

Other people and things beside the tracked bodies have no model. While there is a gap between them and every
body, they form separate components of the foreground. Once the gap has closed, whatever is nearer to their
points in the last frame than to a body's surface still counts as theirs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.camera import Pinhole, points_of, project
from gepf.common.compiling import numba
from gepf.common.frame import EMPTY, HIDDEN, SUBJECT, UNKNOWN, UNMEASURED
from gepf.coordinator.scene.noise import DepthNoise, margin_at
from gepf.coordinator.scene.occupancy import Window
from gepf.coordinator.scene.scene import FOREGROUND, NO_DEPTH, NO_POINTS, ON_PLANE, Depth, SceneView
from gepf.coordinator.settings import SegmentationSettings

Labels = NDArray[np.uint8]
Points = NDArray[np.float32]  # (N, 3), camera frame, metres


@dataclass(frozen=True, slots=True, eq=False)
class Segmentation:
    """The labels of a window of the frame.

    window: Left, top, right and bottom. labels: (H, W) of its pixels: SUBJECT; EMPTY: something farther was
    measured; HIDDEN: something nearer was measured; UNMEASURED; UNKNOWN.
    """

    window: Window
    labels: Labels


def slices(window: Window) -> tuple[slice, slice]:
    """Rows and columns of a window."""
    left, top, right, bottom = window
    return slice(top, bottom), slice(left, right)


def reach_of(settings: SegmentationSettings) -> float:
    """The largest distance of the subject from the surface, metres."""
    return settings.cell_m * settings.reach_cells


def measure_distances(view: SceneView, surface: Array) -> Depth:
    """Distances (H, W) in metres of the pixels' points from a surface (V, 3); infinite beyond the reach.

    They come from a distance field: a grid of cells around the surface, filled along one axis after another.
    """
    cell_m, reach_cells = view.settings.segmentation.cell_m, view.settings.segmentation.reach_cells
    margin = reach_of(view.settings.segmentation) + cell_m
    origin = surface.min(axis=0) - margin
    shape = tuple(((surface.max(axis=0) + margin - origin) / cell_m).astype(np.int64) + 1)
    far = (reach_cells + 1) ** 2
    squares = np.full(shape, far, dtype=np.uint8)
    squares[tuple(((surface - origin) / cell_m).astype(np.int64).T)] = 0
    flat = squares.ravel()
    # the margin keeps shifts of the flattened grid from reaching the next line
    for stride in (1, shape[2], shape[1] * shape[2]):
        before = flat.copy()
        for step in range(1, reach_cells + 1):
            shift, more = step * stride, np.uint8(step * step)
            np.minimum(flat[:-shift], before[shift:] + more, out=flat[:-shift])
            np.minimum(flat[shift:], before[:-shift] + more, out=flat[shift:])
    metres = np.float32(cell_m) * np.sqrt(np.arange(far + 1, dtype=np.float32))
    metres[reach_cells**2 + 1 :] = np.inf
    squares = np.minimum(squares, far)
    return look_up(
        view.depth, view.intrinsics.pinhole, window_of(view, surface), origin, cell_m, squares, metres
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def look_up(
    depth: Depth,
    pinhole: Pinhole,
    window: Window,
    origin: Array,
    cell_m: float,
    squares: NDArray[np.uint8],
    metres: Depth,
) -> Depth:
    """Distances (H, W) in a window, infinite outside; looked up in a grid that begins at `origin` (3,).

    squares: squared distances of the grid's cells, in cells. metres: the distance for each of these values.
    """
    distances = np.full(depth.shape, np.inf, dtype=np.float32)
    fx, fy, cx, cy = pinhole
    left, top, right, bottom = window
    wide, high, deep = squares.shape
    nearest, farthest = origin[2], origin[2] + cell_m * deep
    for v in range(top, bottom):
        for u in range(left, right):
            z = depth[v, u]
            if not (z > 0.0 and nearest <= z < farthest):
                continue
            x, y = (u - cx) / fx * z - origin[0], (v - cy) / fy * z - origin[1]
            i, j, k = int(x / cell_m), int(y / cell_m), int((z - origin[2]) / cell_m)
            if x >= 0.0 and y >= 0.0 and i < wide and j < high and k < deep:
                distances[v, u] = metres[squares[i, j, k]]
    return distances


def segment_body(
    view: SceneView, surface: Array, distances: Depth, not_own: Mask | None = None
) -> Segmentation:
    """Label the pixels around the points (V, 3) of a posed body, given distances (H, W) from them, metres.

    Pixels (H, W) that are `not_own`, because they belong to other people or possible people, are labelled
    unknown.
    """
    limits, window = view.settings.segmentation, window_of(view, surface)
    inside = slices(window)
    depth, near, marks = view.depth[inside], distances[inside], view.marks[inside]
    unclear = (marks != FOREGROUND) & (near <= limits.cell_m)
    for mask in (view.out_of_scope, not_own):
        if mask is not None:
            unclear |= mask[inside]
    possible = (marks == FOREGROUND) & (near <= reach_of(limits)) & ~unclear
    parts = label_parts(depth, possible, limits.step_m, limits.step_m, view.noise, view.intrinsics.fx)
    farthest = surface[:, 2].max()
    missing = UNMEASURED if view.shows_room else EMPTY
    labels = label_pixels(
        view.depth, view.marks, distances, window[:2], unclear, parts, limits.near_m, farthest, missing
    )
    return Segmentation(window, labels)


@numba.njit(cache=True, nogil=True)
def label_pixels(  # noqa: PLR0913 a kernel
    depth: Depth,
    marks: Labels,
    distances: Depth,
    corner: tuple[int, int],
    unclear: Mask,
    parts: NDArray[np.int32],
    near_m: float,
    farthest: float,
    missing: int,
) -> Labels:
    """Labels (h, w) of a window with this corner (left, top); depth, marks and distances are (H, W).

    The subject consists of those components in `parts` (h, w) that come within `near_m` of the body. No point
    of the body is beyond `farthest`. Pixels without depth get the label `missing`.
    """
    left, top = corner
    labels = np.empty(parts.shape, dtype=np.uint8)
    chosen = np.zeros(parts.size + 1, dtype=np.bool_)
    for v in range(parts.shape[0]):
        for u in range(parts.shape[1]):
            if parts[v, u] > 0 and distances[top + v, left + u] <= near_m:
                chosen[parts[v, u]] = True
    for v in range(parts.shape[0]):
        for u in range(parts.shape[1]):
            mark = marks[top + v, left + u]
            if chosen[parts[v, u]]:
                labels[v, u] = SUBJECT
            elif unclear[v, u]:
                labels[v, u] = UNKNOWN
            elif mark == NO_DEPTH:
                labels[v, u] = missing
            else:
                labels[v, u] = HIDDEN if mark != ON_PLANE and depth[top + v, left + u] < farthest else EMPTY
    return labels


def segment_masks(
    view: SceneView, masks: Sequence[Mask], not_own: Mask | None = None
) -> tuple[Segmentation, ...]:
    """Label the pixels for a person without a posed body, once for each mask (H, W) of the person's pixels.

    The last mask contains all others. The surroundings of all masks are labelled relative to the last,
    widest one; for a narrower mask, the remaining pixels of the widest one are unknown.
    """
    points = points_of(view.depth, view.intrinsics, masks[-1])
    reach_m = reach_of(view.settings.segmentation)
    behind = points * (1.0 + reach_m / points[:, 2:])  # about the thickness of a person
    surface = np.concatenate([points, behind])
    whole = segment_body(view, surface, measure_distances(view, surface), not_own)
    around = np.where(whole.labels == SUBJECT, np.uint8(UNKNOWN), whole.labels)
    inside = slices(whole.window)
    return tuple(replace(whole, labels=np.where(mask[inside], np.uint8(SUBJECT), around)) for mask in masks)


def window_of(view: SceneView, surface: Array) -> Window:
    """The window of pixels that can show something within reach of the points (V, 3)."""
    width, height = view.intrinsics.width, view.intrinsics.height
    reach_m = reach_of(view.settings.segmentation)
    nearest = surface[:, 2] - reach_m
    if nearest.min() <= 0.0:
        return 0, 0, width, height
    fx, fy, cx, cy = view.intrinsics.pinhole
    u, v = cx + fx * surface[:, 0] / surface[:, 2], cy + fy * surface[:, 1] / surface[:, 2]
    across, along = reach_m * fx / nearest, reach_m * fy / nearest
    left, right = np.clip([(u - across).min(), (u + across).max() + 2.0], 0.0, width).astype(int).tolist()
    top, bottom = np.clip([(v - along).min(), (v + along).max() + 2.0], 0.0, height).astype(int).tolist()
    return left, top, right, bottom


def is_missing(view: SceneView, surface: Array, segmentation: Segmentation) -> bool:
    """Whether most of the points (V, 3) of a posed body project to empty pixels."""
    u, v = (project(surface[surface[:, 2] > 0.0], view.intrinsics) - segmentation.window[:2]).T
    rows, columns = segmentation.labels.shape
    inside = (u >= 0.0) & (u < columns) & (v >= 0.0) & (v < rows)
    labels = segmentation.labels[v[inside].astype(int), u[inside].astype(int)]
    return bool(np.count_nonzero(labels == EMPTY) >= 0.5 * len(labels))


def nearest_of(view: SceneView, distances: Sequence[Depth]) -> Depth:
    """Distances (H, W) from the nearest body, given those from each; infinite without a body."""
    return reduce(np.minimum, distances or [np.full(view.depth.shape, np.inf, dtype=np.float32)])


@numba.njit(cache=True, nogil=True)
def label_parts(
    depth: Depth, inside: Mask, step_m: float, gap_m: float, noise: DepthNoise, focal: float
) -> NDArray[np.int32]:
    """Label connected components in depth (H, W) among the pixels inside: 1, 2, ... from the top; 0 outside.

    Neighbouring pixels are connected if their depths differ by less than `step_m` plus the noise margin. A
    gap without depth separates pixels only if it is wider than `gap_m`; `focal` is in pixels.
    """
    labels = np.zeros(depth.shape, dtype=np.int32)
    rows, columns = depth.shape
    stack = np.empty(rows * columns, dtype=np.int64)
    last, free, flat = 0, inside.ravel(), labels.ravel()
    for start in range(rows * columns):
        if not free[start] or flat[start] != 0:
            continue
        last += 1
        flat[start] = last
        stack[0], count = start, 1
        while count > 0:
            count -= 1
            row, column = stack[count] // columns, stack[count] % columns
            z = depth[row, column]
            max_step, reach = step_m + margin_at(z, noise), 1 + int(gap_m * focal / z)
            for k in range(4):
                down, right = (k == 1) - (k == 0), (k == 3) - (k == 2)
                # step over pixels without depth; r, c: the first pixel with depth or outside the image, or
                # the last within reach
                for n in range(1, reach + 1):
                    r, c = row + n * down, column + n * right
                    if not (0 <= r < rows and 0 <= c < columns) or depth[r, c] > 0.0:
                        break
                if not (0 <= r < rows and 0 <= c < columns) or not inside[r, c] or labels[r, c] > 0:
                    continue
                if abs(depth[r, c] - z) < max_step:
                    labels[r, c] = last
                    stack[count] = r * columns + c
                    count += 1
    return labels


@numba.njit(cache=True, nogil=True)
def measure_components(
    labels: NDArray[np.int32], depth: Depth, fx: float, fy: float
) -> tuple[Array, Indices]:
    """Visible areas (L + 1,), square metres, and windows (L + 1, 4) of components by their labels (H, W).

    The area of label 0 is 0. A window is left, top, right and bottom; fx and fy are in pixels.
    """
    count = labels.max() + 1
    areas, windows = np.zeros(count), np.empty((count, 4), dtype=np.int64)
    windows[:, :2], windows[:, 2:] = max(labels.shape), 0
    for v in range(labels.shape[0]):
        for u in range(labels.shape[1]):
            label = labels[v, u]
            if label > 0:
                areas[label] += depth[v, u] * depth[v, u] / (fx * fy)
                window = windows[label]
                window[0], window[1] = min(window[0], u), min(window[1], v)
                window[2], window[3] = max(window[2], u + 1), max(window[3], v + 1)
    return areas, windows


def mark_foreign(view: SceneView, nearest: Depth, nearest_new: Depth) -> Mask:
    """Pixels (H, W) of other people and things, given their points in the frame before, `view.foreign`.

    nearest: distances (H, W) from the nearest body. nearest_new: the same for the bodies that were detected a
    short time ago, whose limbs may not be where they should be.
    """
    foreign = mark_apart(view, nearest)
    if len(view.foreign):
        points = view.foreign.astype(np.float64)
        distances = measure_distances(view, points) + view.settings.segmentation.cell_m
        foreign |= (view.marks == FOREGROUND) & (distances < nearest) & np.isinf(nearest_new)
    return foreign


def points_beside(view: SceneView, foreign: Mask, surfaces: Sequence[Array]) -> Points:
    """Some of the foreign points (N, 3) around the surfaces (V, 3) of bodies, camera frame, metres."""
    if not surfaces or not foreign.any():
        return NO_POINTS
    limits, surface = view.settings.segmentation, np.concatenate(surfaces)
    points = points_of(view.depth, view.intrinsics, foreign)
    low, high = surface.min(axis=0) - limits.beside_m, surface.max(axis=0) + limits.beside_m
    points = points[np.all((points > low) & (points < high), axis=1)]
    return points[:: 1 + len(points) // limits.beside_points].astype(np.float32)


def mark_apart(view: SceneView, nearest: Depth) -> Mask:
    """Pixels (H, W) of other people and things beside bodies, from the distances to the nearest body.

    They are connected components of the foreground that are farther than `near_m` from every body, come
    within reach of a body, extend beyond that distance, and are too large to be a limb.
    """
    limits = view.settings.segmentation
    min_area = limits.min_person_m2 * view.intrinsics.fx * view.intrinsics.fy
    free = view.marks == FOREGROUND
    return grow_apart(
        view.depth, free, nearest, view.noise, limits.near_m, reach_of(limits), limits.step_m, min_area
    )


@numba.njit(cache=True, nogil=True)
def grow_apart(
    depth: Depth,
    free: Mask,
    distances: Depth,
    noise: DepthNoise,
    near_m: float,
    reach_m: float,
    step_m: float,
    min_area: float,
) -> Mask:
    """Pixels (H, W) as in `mark_apart`; changes `free` in place. `min_area` is in pixels times z^2."""
    rows, columns = depth.shape
    apart = np.zeros(depth.shape, dtype=np.bool_)
    grown = np.empty(rows * columns, dtype=np.int64)
    flat_distances, flat_free = distances.ravel(), free.ravel()
    for start in range(rows * columns):
        if not flat_free[start] or flat_distances[start] <= near_m or flat_distances[start] > reach_m:
            continue
        grown[0] = start
        count, head = 1, 0
        area, beyond = 0.0, False
        flat_free[start] = False
        while head < count:
            row, column = grown[head] // columns, grown[head] % columns
            head += 1
            z = depth[row, column]
            area += z * z
            beyond |= distances[row, column] > reach_m
            step = step_m + margin_at(z, noise)
            for k in range(4):
                r, c = row + (k == 1) - (k == 0), column + (k == 3) - (k == 2)
                if not (0 <= r < rows and 0 <= c < columns) or not free[r, c]:
                    continue
                if distances[r, c] > near_m and abs(depth[r, c] - z) < step:
                    free[r, c] = False
                    grown[count] = r * columns + c
                    count += 1
        if beyond and area >= min_area:
            for k in range(count):
                apart[grown[k] // columns, grown[k] % columns] = True
    return apart
