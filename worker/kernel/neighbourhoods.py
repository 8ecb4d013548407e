"""An order of points in which neighbours stand together, so that a few in a row have a small bounding box."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba

Array = NDArray[np.float64]
Points = NDArray[np.float32]
Indices = NDArray[np.int64]

TILE = 16  # observed points that are searched for together
BLOCK = 64  # observed points that share a list of candidates


@numba.njit(cache=True, nogil=True)
def neighbourhoods(points: Array, small: int, large: int) -> Indices:
    """An order (P,) of points (P, 3) in which every `large` in a row, and every `small`, lie close together.

    As in a k-d tree: halved along the longest side of their box again and again, but always at a multiple
    of `large` points, and below that of `small`, so that only the last few are fewer.
    """
    order, moved = np.arange(len(points)), points.copy()
    waiting = [(0, len(points))]
    while len(waiting) > 0:
        start, stop = waiting.pop()
        unit = large if stop - start > large else small
        if stop - start > unit:
            middle = start + (stop - start + unit - 1) // unit // 2 * unit
            halve(moved, order, start, stop, middle, longest_side(moved, start, stop))
            waiting.append((start, middle))
            waiting.append((middle, stop))
    return order


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def longest_side(points: Array, start: int, stop: int) -> int:
    """The axis along which points start..stop extend most."""
    left, top, front = points[start, 0], points[start, 1], points[start, 2]
    right, bottom, back = left, top, front
    for i in range(start + 1, stop):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        left, right = min(left, x), max(right, x)
        top, bottom = min(top, y), max(bottom, y)
        front, back = min(front, z), max(back, z)
    width, height, depth = right - left, bottom - top, back - front
    if width >= height and width >= depth:
        return 0
    return 1 if height >= depth else 2


@numba.njit(cache=True, nogil=True)
def halve(points: Array, order: Indices, start: int, stop: int, middle: int, axis: int) -> None:
    """Move points start..stop and their places in `order` so that none before `middle` lies beyond one after.

    Hoare's selection.
    """
    low, high = start, stop - 1
    while low < high:
        pivot = points[(low + high) // 2, axis]
        i, j = low, high
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                swap(points, order, i, j)
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@numba.njit(cache=True, nogil=True, inline="always")
def swap(points: Array, order: Indices, i: int, j: int) -> None:
    """Each takes the other's place."""
    for a in range(3):
        points[i, a], points[j, a] = points[j, a], points[i, a]
    order[i], order[j] = order[j], order[i]


def boxes_of(points: Points, size: int) -> Points:
    """Bounding boxes (6, K) of every `size` points in a row, of points (3, P)."""
    boxes = np.empty((6, points.shape[1] // size), dtype=np.float32)
    enclose_rows(points, size, boxes)
    return boxes


@numba.njit(cache=True, nogil=True)
def enclose_rows(points: Points, size: int, boxes: Points) -> None:
    """Fill boxes (6, K): lowest and highest x, y, z of every `size` points (3, P) in a row."""
    for a in range(3):
        for k in range(boxes.shape[1]):
            low = high = points[a, k * size]
            for i in range(k * size + 1, (k + 1) * size):
                low = min(low, points[a, i])
                high = max(high, points[a, i])
            boxes[a, k], boxes[3 + a, k] = low, high
