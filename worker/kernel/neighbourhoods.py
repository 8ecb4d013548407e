"""Orders points such that successive points are neighbours with a small bounding box."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.compiling import numba


@numba.njit(cache=True, nogil=True)
def neighbourhoods(points: Array, size: int) -> Indices:
    """An order (P,) of points (P, 3) in which groups of `size`, 2 `size`, ... successive points are compact.

    As in a k-d tree, points are divided recursively along the longest side of the bounding box, such that the
    size of the first part is a power of 2 times `size`.
    """
    order = np.arange(len(points))
    waiting = [(0, len(points))]
    while len(waiting) > 0:
        start, stop = waiting.pop()
        first = size
        while 2 * first < stop - start:
            first *= 2
        if first < stop - start:
            divide(points, order, start, stop, start + first, longest_side(points, order[start:stop]))
            waiting.append((start, start + first))
            waiting.append((start + first, stop))
    return order


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def longest_side(points: Array, some: Indices) -> int:
    """The axis with the largest extent of some of the points (P, 3)."""
    longest, axis = -np.inf, 0
    for a in range(3):
        low = high = points[some[0], a]
        for i in some:
            low, high = min(low, points[i, a]), max(high, points[i, a])
        if high - low > longest:
            longest, axis = high - low, a
    return axis


@numba.njit(cache=True, nogil=True)
def divide(points: Array, order: Indices, start: int, stop: int, middle: int, axis: int) -> None:
    """Rearrange order[start:stop] so that no point before `middle` exceeds one after it.

    Hoare's selection.
    """
    low, high = start, stop - 1
    while low < high:
        pivot = points[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while points[order[i], axis] < pivot:
                i += 1
            while points[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return
