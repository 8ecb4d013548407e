"""An order of points in which neighbours stand together, so that a few in a row have a small box."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@numba.njit(cache=True, nogil=True)
def neighbourhoods(points: Array, small: int, large: int) -> Indices:
    """An order (P,) of points (P, 3) in which every `large` in a row, and every `small`, lie close together.

    As in a k-d tree: halved along the longest side of their box again and again, but always at a multiple
    of `large` points, and below that of `small`, so that only the last few are fewer.
    """
    order = np.arange(len(points))
    waiting = [(0, len(points))]
    while len(waiting) > 0:
        start, stop = waiting.pop()
        unit = large if stop - start > large else small
        if stop - start > unit:
            half = (stop - start + unit - 1) // unit // 2 * unit
            part = order[start:stop].copy()
            along = points[part, longest_side(points, part)]
            order[start:stop] = part[np.argpartition(along, half)]
            waiting.append((start, start + half))
            waiting.append((start + half, stop))
    return order


@numba.njit(cache=True, nogil=True)
def longest_side(points: Array, part: Indices) -> int:
    """The axis along which a part of the points extends most."""
    low, high = points[part[0]].copy(), points[part[0]].copy()
    for i in part:
        for a in range(3):
            low[a] = min(low[a], points[i, a])
            high[a] = max(high[a], points[i, a])
    return int(np.argmax(high - low))
