"""The descriptor of a body: a coarse orthographic depth image around its centre.

The cells are so large that a few hundred points fill them. So it can be computed from vertices of a model and
from observed points, at any distance. Depth is relative to the centre, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.compiling import numba

Image = NDArray[np.float32]

ROWS, COLUMNS = 40, 36
VACANT = np.float32(1e3)  # depth of an empty cell
BOUND_CELLS = 4.0  # largest difference of depth; an empty cell has this difference


@numba.njit(cache=True, nogil=True)
def describe(points: Any, cell: float, image: Image, middle: Array) -> int:
    """Fill image (ROWS, COLUMNS) with the nearest depth of points (P, 3) in each cell, and middle (3,).

    The middle is the mean centre and depth of the cells that are not empty; depth in the image is relative to
    it. Returns the number of cells that are not empty.
    """
    middle[0] = middle[1] = middle[2] = 0.0
    for i in range(len(points)):
        for a in range(2):
            middle[a] += points[i, a] / len(points)
    splat(points, cell, middle, image)
    centre(cell, image, middle)
    count = splat(points, cell, middle, image)
    total, depths = 0.0, image.ravel()
    for k in range(len(depths)):
        if depths[k] < VACANT:
            total += depths[k]
    middle[2] = total / max(count, 1)
    for k in range(len(depths)):
        if depths[k] < VACANT:
            depths[k] -= np.float32(middle[2])
    return count


@numba.njit(cache=True, nogil=True)
def splat(points: Any, cell: float, middle: Array, image: Image) -> int:
    """Fill image with the nearest depth in each cell around middle (3,); returns how many are filled."""
    image[:] = VACANT
    count = 0
    for i in range(len(points)):
        column = int(np.floor((points[i, 0] - middle[0]) / cell + 0.5 * COLUMNS))
        row = int(np.floor((points[i, 1] - middle[1]) / cell + 0.5 * ROWS))
        if 0 <= column < COLUMNS and 0 <= row < ROWS:
            if image[row, column] == VACANT:
                count += 1
            image[row, column] = min(image[row, column], np.float32(points[i, 2]))
    return count


@numba.njit(cache=True, nogil=True)
def centre(cell: float, image: Image, middle: Array) -> None:
    """Move middle (3,) to the mean centre of the cells of image that are not empty."""
    across, down, count = 0.0, 0.0, 0
    for row in range(ROWS):
        for column in range(COLUMNS):
            if image[row, column] < VACANT:
                across += column + 0.5 - 0.5 * COLUMNS
                down += row + 0.5 - 0.5 * ROWS
                count += 1
    if count > 0:
        middle[0] += across / count * cell
        middle[1] += down / count * cell


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def fill_differences(cells: Image, occupied: Image, image: Image, bound: float, out: Image) -> None:
    """Fill out (N,) with the differences of descriptors from an image: the sum of min(|dz|, bound)^2.

    cells: Descriptors (ROWS * COLUMNS, N); occupied: number of cells of each that are not empty.
    """
    worst, depths, none = np.float32(bound * bound), image.ravel(), np.float32(0.0)
    for n in range(len(out)):
        out[n] = worst * occupied[n]
    for k in range(len(depths)):
        if depths[k] < VACANT:
            line, depth = cells[k], depths[k]
            for n in range(len(out)):
                apart = line[n] - depth
                both = worst if line[n] < VACANT else none
                out[n] += min(apart * apart, worst) - both
