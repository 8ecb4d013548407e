"""The nearest occupied pixel of each pixel of a mask."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Indices, Mask
from gepf.common.compiling import numba

Pixels = NDArray[np.int32]

NONE = -1  # instead of a row, if a column has no occupied pixel


@numba.njit(cache=True, nogil=True)
def nearest_occupied_pixels(occupied: Mask) -> Pixels:
    """Row and column (2, H, W) of the nearest occupied pixel; the pixel itself if there is none.

    An exact distance transform in two passes (Meijster, Roerdink and Hesselink, 2000): along columns, and
    then along rows by the lower envelope of parabolas. scipy.ndimage has the same function, but its import
    would be a quarter of a worker's start, and it takes four times as long.
    """
    height, width = occupied.shape
    found = np.empty((2, height, width), dtype=np.int32)
    nearest_rows(occupied, found[0])
    row, best, start = found[0].copy(), np.empty(width, dtype=np.int64), np.empty(width, dtype=np.int64)
    for v in range(height):
        last = lower_envelope(v, row[v], best, start)
        for u in range(width - 1, -1, -1):
            if last < 0:
                found[0, v, u], found[1, v, u] = v, u
                continue
            found[0, v, u], found[1, v, u] = row[v, best[last]], best[last]
            if u == start[last]:
                last -= 1
    return found


@numba.njit(cache=True, nogil=True)
def nearest_rows(occupied: Mask, out: Pixels) -> None:
    """Fill out (H, W) with the row of the nearest occupied pixel in the same column, NONE without any."""
    height, width = occupied.shape
    for v in range(height):
        for u in range(width):
            above = out[v - 1, u] if v > 0 else NONE
            out[v, u] = v if occupied[v, u] else above
    for v in range(height - 2, -1, -1):
        for u in range(width):
            below = out[v + 1, u]
            if below != NONE and (out[v, u] == NONE or below - v < v - out[v, u]):
                out[v, u] = below


@numba.njit(cache=True, nogil=True, error_model="numpy")
def lower_envelope(v: int, row: Pixels, best: Indices, start: Indices) -> int:
    """Which columns are nearest along row v: best[k] from column start[k]; returns the last k, or -1.

    row (W,) holds the nearest row in each column.
    """
    last = -1
    for u in range(len(row)):
        if row[u] == NONE:
            continue
        high, begins = (v - row[u]) ** 2, 0
        while last >= 0:
            other = best[last]
            lead = u * u - other * other + high - (v - row[other]) ** 2
            begins = int(np.floor(lead / (2.0 * (u - other)))) + 1  # of equally near columns the first stays
            if begins > start[last]:
                break
            last -= 1
        if last < 0:
            begins = 0
        if begins < len(row):
            last += 1
            best[last], start[last] = u, begins
    return last
