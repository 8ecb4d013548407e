"""The nearest pixel where the subject may be, for every pixel: what draws the model into the silhouette.

Exact, in two passes (Meijster, Roerdink and Hesselink, 2000): along columns, and then along rows by the lower
envelope of the parabolas that the columns leave. scipy.ndimage finds the same, but its import would be a
quarter of a worker's start.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba

Pixels = NDArray[np.int32]
FAR = -1


@numba.njit(cache=True, nogil=True)
def nearest_occupied_pixels(occupied: NDArray[np.bool_]) -> Pixels:
    """Row and column (2, H, W) of the nearest occupied pixel; its own where there is none."""
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
def nearest_rows(occupied: NDArray[np.bool_], out: Pixels) -> None:
    """Fill out (H, W) with the row of the nearest occupied pixel in the same column, FAR without any."""
    height, width = occupied.shape
    for v in range(height):
        for u in range(width):
            above = out[v - 1, u] if v > 0 else FAR
            out[v, u] = v if occupied[v, u] else above
    for v in range(height - 2, -1, -1):
        for u in range(width):
            below = out[v + 1, u]
            if below != FAR and (out[v, u] == FAR or below - v < v - out[v, u]):
                out[v, u] = below


@numba.njit(cache=True, nogil=True, error_model="numpy")
def lower_envelope(v: int, row: Pixels, best: NDArray[np.int64], start: NDArray[np.int64]) -> int:
    """Which columns are nearest along row v: best[k] from column start[k] on; gives the last k, -1 for none.

    row (W,) holds the nearest row in each column.
    """
    last = -1
    for u in range(len(row)):
        if row[u] == FAR:
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
