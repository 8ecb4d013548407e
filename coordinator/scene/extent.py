"""Where a posed body is in a picture, in blocks of pixels: how far back it reaches, how much is seen."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.frame import EMPTY, SUBJECT
from coordinator.scene.nearness import CELL
from coordinator.scene.room.marks import Depth, Lens

Array = NDArray[np.float64]
Kinds = NDArray[np.uint8]

BLOCK = 8  # pixels a side


def share_shown(kinds: Kinds, lens: Lens, surface: Array) -> float:
    """The subject's share of the pixels in which a body would be seen, and it or something behind it is.

    1 where nothing is measured there that could speak against it.
    kinds: (H, W) of a window's pixels, whose lens this is. surface: Points (V, 3) of the body, metres.
    """
    back = np.zeros(blocks_of(kinds.shape), dtype=np.float32)
    lay_back(np.ascontiguousarray(surface, dtype=np.float64), lens, back)
    rows, columns = kinds.shape
    expected = np.kron(back > 0.0, np.ones((BLOCK, BLOCK), dtype=np.bool_))[:rows, :columns]
    shown = int(np.count_nonzero(kinds == SUBJECT))
    missing = int(np.count_nonzero(expected & (kinds == EMPTY)))
    return shown / (shown + missing) if shown + missing else 1.0


def reach_back(surface: Array, lens: Lens, shape: tuple[int, int]) -> NDArray[np.float32]:
    """How far back the points (V, 3) reach in each block of pixels, and in those around; metres."""
    back = np.zeros(blocks_of(shape), dtype=np.float32)
    fill_back(np.ascontiguousarray(surface, dtype=np.float64), lens, back)
    return back


def blocks_of(shape: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of blocks in a picture of so many pixels."""
    return -(-shape[0] // BLOCK), -(-shape[1] // BLOCK)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_back(surface: Array, lens: Lens, back: Depth) -> None:
    """Fill back (R, C) with the greatest z of the points (V, 3) in each block, or in those nearest to it."""
    lay_back(surface, lens, back)
    while spread_back(back.copy(), back):
        pass


@numba.njit(cache=True, nogil=True, error_model="numpy")
def lay_back(surface: Array, lens: Lens, back: Depth) -> None:
    """Fill back (R, C), which is 0, with the greatest z of the points (V, 3) in each block."""
    fx, fy, cx, cy = lens
    rows, columns = back.shape
    for n in range(len(surface)):
        z = surface[n, 2]
        if z > CELL:
            c, r = int((cx + fx * surface[n, 0] / z) // BLOCK), int((cy + fy * surface[n, 1] / z) // BLOCK)
            if 0 <= r < rows and 0 <= c < columns:
                back[r, c] = max(back[r, c], z)


@numba.njit(cache=True, nogil=True)
def spread_back(before: Depth, back: Depth) -> bool:
    """Fill what is 0 in back (R, C) with the greatest of its neighbours; gives whether more is to do."""
    rows, columns = back.shape
    filled = missing = False
    for r in range(rows):
        for c in range(columns):
            if before[r, c] > 0.0:
                continue
            around = before[max(0, r - 1) : r + 2, max(0, c - 1) : c + 2]
            back[r, c] = around.max()
            filled, missing = filled or back[r, c] > 0.0, missing or back[r, c] == 0.0
    return filled and missing
