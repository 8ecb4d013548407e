"""How far points are from a posed body, by a grid of cells around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba

Array = NDArray[np.float64]
Steps = NDArray[np.uint8]

CELL = 0.04  # metres
CAP = 8  # cells; what is farther counts as so far
BEYOND = np.uint8(CAP * CAP)


@dataclass(frozen=True, slots=True, eq=False)
class Nearness:
    """Squared distances in cells from a surface, in a grid that begins at `low`."""

    low: Array  # (3,) metres, camera frame
    squares: Steps  # (X, Y, Z), BEYOND at the most


def surround(surface: Array) -> Nearness:
    """The grid around the points (V, 3) of a surface, metres."""
    points = np.ascontiguousarray(surface, dtype=np.float64)
    low, high = extremes(points)
    low -= CAP * CELL
    size = np.ceil((high + CAP * CELL - low) / CELL).astype(np.int64) + 1
    squares = np.full(tuple(size.tolist()), BEYOND, dtype=np.uint8)
    spread(points, low, squares)
    return Nearness(low, squares)


@numba.njit(cache=True, nogil=True)
def extremes(points: Array) -> tuple[Array, Array]:
    """The least and greatest coordinates (3,) of points (V, 3)."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for n in range(len(points)):
        for a in range(3):
            low[a], high[a] = min(low[a], points[n, a]), max(high[a], points[n, a])
    return low, high


@numba.njit(cache=True, nogil=True)
def spread(surface: Array, low: Array, squares: Steps) -> None:
    """Fill squares (X, Y, Z), BEYOND before, with the squared distance from points (V, 3), axis by axis."""
    for n in range(len(surface)):
        i = int((surface[n, 0] - low[0]) / CELL)
        j = int((surface[n, 1] - low[1]) / CELL)
        k = int((surface[n, 2] - low[2]) / CELL)
        squares[i, j, k] = 0
    before = squares.copy()
    for i in range(squares.shape[0]):
        for j in range(squares.shape[1]):
            spread_line(before[i, j], squares[i, j])
    before[:] = squares
    for i in range(squares.shape[0]):
        spread_rows(before[i].ravel(), squares.shape[2], squares[i].ravel())
    before[:] = squares
    spread_rows(before.ravel(), squares.shape[1] * squares.shape[2], squares.ravel())


@numba.njit(cache=True, nogil=True)
def spread_rows(before: Steps, width: int, after: Steps) -> None:
    """Lower what is after (N * width,) to what was before in each row so and so far off, and that square."""
    for step in range(1, CAP):
        more, shift = np.uint8(step * step), step * width
        for k in range(len(after) - shift):
            less = np.uint8(before[k + shift] + more)
            after[k] = min(after[k], less)
        for k in range(shift, len(after)):
            less = np.uint8(before[k - shift] + more)
            after[k] = min(after[k], less)


@numba.njit(cache=True, nogil=True)
def spread_line(before: Steps, line: Steps) -> None:
    """Squared distances along a line (Z,) from where it was 0 before."""
    for k in range(len(line)):
        if before[k] == 0:
            for other in range(max(0, k - CAP + 1), min(len(line), k + CAP)):
                line[other] = min(line[other], np.uint8((other - k) * (other - k)))


@numba.njit(cache=True, nogil=True, inline="always")
def square_at(x: float, y: float, z: float, low: Array, squares: Steps) -> int:
    """Squared distance in cells at a point; BEYOND outside the grid."""
    i, j, k = int((x - low[0]) / CELL), int((y - low[1]) / CELL), int((z - low[2]) / CELL)
    inside = x >= low[0] and y >= low[1] and z >= low[2]
    if inside and i < squares.shape[0] and j < squares.shape[1] and k < squares.shape[2]:
        return int(squares[i, j, k])
    return int(BEYOND)
