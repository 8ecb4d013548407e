"""The subject's pixels in a scene, and which of the others are empty and which hide something.

What is near the posed body and no part of the room, and what continues it in depth, is the subject's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.frame import EMPTY, HIDDEN, SUBJECT, UNKNOWN, UNMEASURED
from coordinator.scene.extent import BLOCK, reach_back
from coordinator.scene.nearness import CELL, Nearness, square_at, surround
from coordinator.scene.noise import step_at
from coordinator.scene.room.marks import FOREGROUND, NO_DEPTH, PLANE, Depth, Lens, mark_room
from coordinator.scene.unmeasured import tell_emptiness
from coordinator.scene.view import SceneView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Kinds = NDArray[np.uint8]
Squares = NDArray[np.uint8]
Window = tuple[int, int, int, int]  # left, top, right, bottom, half-open

REACH = 0.28  # metres from the posed surface to what may be the subject's
CLOSE = 0.08  # and to what is, if it is no part of the room
CAME = 0.2  # the same, where it was not there before
LEAST_PIXELS = 6  # of a patch that hangs together
LEAST_CAME = (
    0.25  # share of what was not there before, in a patch that is not close: furniture's edges flicker
)


@dataclass(frozen=True, slots=True, eq=False)
class Cut:
    """A subject cut out of a picture.

    window: what of the picture was looked at. kinds: (H, W) of its pixels: SUBJECT; EMPTY, where something
    farther was measured; HIDDEN, where something nearer was; UNMEASURED; UNKNOWN. near: distances from the
    body. emptiness: how surely the body is not where nothing was measured.
    """

    window: Window
    kinds: Kinds
    near: Nearness
    emptiness: float = 0.0


def cut_out(
    view: SceneView,
    surface: Array,
    near: Nearness | None = None,
    others: Mask | None = None,
    reach: float = REACH,
) -> Cut:
    """The subject near the points (V, 3) of a posed body, metres.

    Args:
        view: The frame in its scene.
        surface: The points.
        near: Distances from them, if they are known.
        others: Pixels (H, W) that are other people's, or may be: they say nothing of this one.
        reach: Metres from the surface to what may be the subject's.
    """
    near = near or surround(surface)
    window = left, top, right, bottom = find_window(view, surface)
    depth = view.depth[top:bottom, left:right]
    kinds = np.empty(depth.shape, dtype=np.uint8)
    fx, fy, cx, cy = view.lens
    lens = (fx, fy, cx - left, cy - top)
    if depth.size:
        growth, background = view.noise.growth, view.background[top:bottom, left:right]
        mark_room(depth, background, lens, view.planes.coefficients, growth, kinds)
        if view.left_out is not None:
            kinds[view.left_out[top:bottom, left:right]] = DOUBTFUL
        if others is not None:
            kinds[others[top:bottom, left:right]] = DOUBTFUL
        mark_near(depth, background, lens, near.low, near.squares, reach, kinds)
        grow(depth, growth, kinds)
        tell_kinds(depth, reach_back(surface, lens, depth.shape), not view.furnished, kinds)
    return Cut(window, kinds, near, tell_emptiness(surface, lens, kinds))


def cut_mask(view: SceneView, mask: Mask, others: Mask | None = None) -> Cut:
    """The same of somebody whose pixels (H, W) are known, of whom there is no posed body yet."""
    around = view.depth[mask]
    rows, columns = np.nonzero(mask)
    fx, fy, cx, cy = view.lens
    z = around.astype(np.float64)
    points = np.column_stack([(columns - cx) / fx * z, (rows - cy) / fy * z, z])
    behind = points * (1.0 + THICKNESS / z)[:, None]
    cut = cut_out(view, np.concatenate([points, behind]), others=others)
    left, top, right, bottom = cut.window
    other = (cut.kinds == SUBJECT) & ~mask[top:bottom, left:right]
    cut.kinds[mask[top:bottom, left:right]] = SUBJECT
    cut.kinds[other] = UNKNOWN
    return replace(cut, emptiness=0.0)


THICKNESS = 0.25  # metres that a person goes on behind what is seen


def find_window(view: SceneView, surface: Array) -> Window:
    """The pixels in which something within REACH of the surface (V, 3) can be seen."""
    width, height = view.camera.width, view.camera.height
    left, top, right, bottom = bounds(np.ascontiguousarray(surface, dtype=np.float64), view.lens)
    first, above = int(min(max(left, 0), width)), int(min(max(top, 0), height))
    last, below = int(min(max(right + 2, 0), width)), int(min(max(bottom + 2, 0), height))
    return first, above, max(first, last), max(above, below)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def bounds(surface: Array, lens: Lens) -> tuple[float, float, float, float]:
    """Left, top, right and bottom in pixels of what is within REACH of points (V, 3)."""
    fx, fy, cx, cy = lens
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    for n in range(len(surface)):
        z = surface[n, 2]
        if z - REACH < CLOSEST:
            return -np.inf, -np.inf, np.inf, np.inf
        u, v = cx + fx * surface[n, 0] / z, cy + fy * surface[n, 1] / z
        across, along = REACH * fx / (z - REACH), REACH * fy / (z - REACH)
        left, right = min(left, u - across), max(right, u + across)
        top, bottom = min(top, v - along), max(bottom, v + along)
    return left, top, right, bottom


CLOSEST = 0.1  # metres from the camera's plane


DOUBTFUL = 4  # while the subject grows: body on the floor
NEAR, NEW, SEED, TAKEN = 8, 9, 10, 11  # and what may be it: near, and was not there before; close; is it
TOUCHING = 1  # squared cells between the posed surface and the room, where the two cannot be told apart


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mark_near(
    depth: Depth,
    background: Depth,
    lens: Lens,
    low: Array,
    squares: Squares,
    reach_m: float,
    marks: Kinds,
) -> None:
    """Mark what of the foreground is near the body, and what of the room touches it; marks of `mark_room`.

    Where the background is known, what came before it is the subject's from somewhat farther, too.
    """
    fx, fy, cx, cy = lens
    reach, close, came = (reach_m / CELL) ** 2, (CLOSE / CELL) ** 2, (CAME / CELL) ** 2
    nearest, farthest = low[2], low[2] + CELL * squares.shape[2]
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            if marks[v, u] == NO_DEPTH or not nearest <= z < farthest:
                continue
            square = square_at((u - cx) / fx * z, (v - cy) / fy * z, z, low, squares)
            if marks[v, u] != FOREGROUND:
                if square <= TOUCHING:
                    marks[v, u] = DOUBTFUL
            elif square <= close:
                marks[v, u] = SEED
            elif square <= came and background[v, u] > z:
                marks[v, u] = NEW
            elif square <= reach:
                marks[v, u] = NEAR


@numba.njit(cache=True, nogil=True)
def grow(depth: Depth, growth: float, marks: Kinds) -> None:
    """Turn into TAKEN what hangs together with a seed, or is mostly new; the rest is foreground again."""
    rows, columns = depth.shape
    flooded = np.zeros((rows, columns), dtype=np.bool_)
    stack = np.empty(rows * columns, dtype=np.int64)
    for v in range(rows):
        for u in range(columns):
            if (marks[v, u] == SEED or marks[v, u] == NEW) and not flooded[v, u]:
                count = flood(v, u, depth, growth, marks, flooded, stack)
                settle(stack[:count], marks)
    for v in range(rows):
        for u in range(columns):
            if NEAR <= marks[v, u] < TAKEN:
                marks[v, u] = FOREGROUND


@numba.njit(cache=True, nogil=True)
def settle(patch: NDArray[np.int64], marks: Kinds) -> None:
    """Turn a patch (N,) of flat indices into TAKEN, or into foreground where it is not the subject's."""
    columns, close, new = marks.shape[1], 0, 0
    for place in patch:
        close += marks[place // columns, place % columns] == SEED
        new += marks[place // columns, place % columns] == NEW
    mine = len(patch) >= LEAST_PIXELS and (close > 0 or new >= LEAST_CAME * len(patch))
    for place in patch:
        marks[place // columns, place % columns] = TAKEN if mine else FOREGROUND


@numba.njit(cache=True, nogil=True)
def flood(
    v: int,
    u: int,
    depth: Depth,
    growth: float,
    marks: Kinds,
    flooded: NDArray[np.bool_],
    stack: NDArray[np.int64],
) -> int:
    """Flood from a pixel what hangs together with it; its pixels are the first on the stack: how many."""
    rows, columns = depth.shape
    flooded[v, u] = True
    stack[0] = v * columns + u
    count, done = 1, 0
    while done < count:
        row, column = stack[done] // columns, stack[done] % columns
        done += 1
        z = depth[row, column]
        step = step_at(z, growth)
        for k in range(4):
            r, c = row + (k == 1) - (k == 0), column + (k == 3) - (k == 2)
            if not (0 <= r < rows and 0 <= c < columns) or marks[r, c] < NEAR or flooded[r, c]:
                continue
            if abs(depth[r, c] - z) < step:
                flooded[r, c] = True
                stack[count] = r * columns + c
                count += 1
    return count


@numba.njit(cache=True, nogil=True)
def tell_kinds(depth: Depth, back: Depth, unmeasured_is_empty: bool, marks: Kinds) -> None:
    """Turn marks (H, W) into kinds: what is nearer than the body reaches hides it; no wall does."""
    rows, columns = depth.shape
    for v in range(rows):
        for u in range(columns):
            mark = marks[v, u]
            if mark == TAKEN:
                marks[v, u] = SUBJECT
            elif mark == NO_DEPTH:
                marks[v, u] = EMPTY if unmeasured_is_empty else UNMEASURED
            elif mark == DOUBTFUL:
                marks[v, u] = UNKNOWN
            elif mark != PLANE and depth[v, u] < back[v // BLOCK, u // BLOCK]:
                marks[v, u] = HIDDEN
            else:
                marks[v, u] = EMPTY
