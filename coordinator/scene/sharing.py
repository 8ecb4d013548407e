"""Pixels that several people are near to: each is one person's, or it is unclear whose.

Surely somebody's is what is much nearer to that posed body than to all others. From there on it spreads over
what hangs together in depth, at the same pace for all, so that an arm stays with the body that it hangs on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from coordinator.scene.cutting import CLOSE, REACH, Squares, Window, find_window
from coordinator.scene.nearness import CELL, Nearness, square_at
from coordinator.scene.noise import step_at
from coordinator.scene.room.marks import FOREGROUND, Depth, Lens, mark_room
from coordinator.scene.view import SceneView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Owners = NDArray[np.int8]

SURELY = 0.08  # metres by which a pixel must be nearer to one body than to another
FREE, UNCLEAR = -1, -2


def share(view: SceneView, surfaces: Sequence[Array], near: Sequence[Nearness]) -> list[Mask | None]:
    """For each of several bodies the pixels (H, W) that are not its own; None where nobody else is near.

    surfaces: points (V, 3) of each body, metres. near: distances from each.
    """
    touching = [n for n, one in enumerate(near) if any(meet(one, each) for each in near if each is not one)]
    others: list[Mask | None] = [None] * len(near)
    if not touching:
        return others
    part = around([find_window(view, surfaces[n]) for n in touching])
    owners = divide(part_of(view, part), [near[n] for n in touching])
    for place, n in enumerate(touching):
        whole = np.zeros(view.depth.shape, dtype=np.bool_)
        whole[rows_of(part), columns_of(part)] = (owners != FREE) & (owners != place)
        others[n] = whole
    return others


def divide(view: SceneView, near: Sequence[Nearness]) -> Owners:
    """Whose each pixel (H, W) is, by place; FREE, or UNCLEAR."""
    marks = np.empty(view.depth.shape, dtype=np.uint8)
    mark_room(view.depth, view.background, view.lens, view.planes.coefficients, view.noise.growth, marks)
    owners, free = np.full(view.depth.shape, FREE, dtype=np.int8), marks == FOREGROUND
    squares = np.array([squares_of(view, each) for each in near])
    claim(squares, free, owners)
    spread(view.depth, view.noise.growth, squares, free, owners)
    leave_open(squares, free, owners)
    return owners


def around(windows: Sequence[Window]) -> Window:
    """The least window that holds several."""
    left, top, right, bottom = zip(*windows, strict=True)
    return min(left), min(top), max(right), max(bottom)


def rows_of(window: Window) -> slice:
    """Its rows."""
    return slice(window[1], window[3])


def columns_of(window: Window) -> slice:
    """Its columns."""
    return slice(window[0], window[2])


def part_of(view: SceneView, window: Window) -> SceneView:
    """A part of the picture."""
    rows, columns = rows_of(window), columns_of(window)
    left, top, right, bottom = window
    return replace(
        view,
        depth=np.ascontiguousarray(view.depth[rows, columns]),
        background=np.ascontiguousarray(view.background[rows, columns]),
        camera=view.camera.crop(left, top, right - left, bottom - top),
    )


def squares_of(view: SceneView, near: Nearness) -> Squares:
    """The squared distance (H, W) in cells of each pixel from a body."""
    squares = np.empty(view.depth.shape, dtype=np.uint8)
    measure(view.depth, view.lens, near.low, near.squares, squares)
    return squares


def meet(one: Nearness, other: Nearness) -> bool:
    """Whether anything may be near to both."""
    high = [each.low + CELL * np.array(each.squares.shape) for each in (one, other)]
    return bool(np.all(one.low < high[1]) and np.all(other.low < high[0]))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def measure(
    depth: Depth, lens: Lens, low: Array, grid: NDArray[np.uint8], squares: NDArray[np.uint8]
) -> None:
    """Fill squares (H, W) with the squared distance in cells of each pixel from a body."""
    fx, fy, cx, cy = lens
    nearest, farthest = low[2], low[2] + CELL * grid.shape[2]
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            squares[v, u] = 255
            if z > 0.0 and nearest <= z < farthest:
                squares[v, u] = square_at((u - cx) / fx * z, (v - cy) / fy * z, z, low, grid)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def claim(squares: NDArray[np.uint8], free: Mask, owners: Owners) -> None:
    """Give to each body what is surely its own, of the free pixels (H, W)."""
    people, rows, columns = squares.shape
    close = (CLOSE / CELL) ** 2
    for v in range(rows):
        for u in range(columns):
            if not free[v, u]:
                continue
            best, least, second = 0, np.inf, np.inf
            for k in range(people):
                square = float(squares[k, v, u])
                if square < least:
                    best, least, second = k, square, least
                elif square < second:
                    second = square
            if least <= close and np.sqrt(second) - np.sqrt(least) >= SURELY / CELL:
                owners[v, u] = best


@numba.njit(cache=True, nogil=True, error_model="numpy")
def spread(depth: Depth, growth: float, squares: NDArray[np.uint8], free: Mask, owners: Owners) -> None:
    """Let all bodies grow at the same pace over what is near them and hangs together with what they have."""
    _, rows, columns = squares.shape
    reach = (REACH / CELL) ** 2
    queue = np.empty(rows * columns, dtype=np.int64)
    claimed = np.flatnonzero(owners.ravel() >= 0)
    queue[: len(claimed)] = claimed
    count, done = len(claimed), 0
    while done < count:
        row, column = queue[done] // columns, queue[done] % columns
        done += 1
        z, owner = depth[row, column], owners[row, column]
        step = step_at(z, growth)
        for k in range(4):
            r, c = row + (k == 1) - (k == 0), column + (k == 3) - (k == 2)
            if not (0 <= r < rows and 0 <= c < columns and free[r, c]) or owners[r, c] != FREE:
                continue
            if squares[owner, r, c] <= reach and abs(depth[r, c] - z) < step:
                owners[r, c] = owner
                queue[count] = r * columns + c
                count += 1


def leave_open(squares: NDArray[np.uint8], free: Mask, owners: Owners) -> None:
    """Mark what is left (H, W) and near to several bodies as unclear."""
    several = np.sum(squares <= (REACH / CELL) ** 2, axis=0) > 1
    owners[free & (owners == FREE) & several] = UNCLEAR


def within(view: SceneView, near: Sequence[Nearness], metres: float) -> Mask:
    """Pixels (H, W) that are so near to any of several bodies."""
    found = np.zeros(view.depth.shape, dtype=np.bool_)
    for each in near:
        found |= squares_of(view, each) <= (metres / CELL) ** 2
    return found
