"""The descriptor of a body: a coarse orthographic depth image around its centre.

The cells are so large that a few hundred points fill them. So it can be computed from vertices of a model and
from observed points, at any distance. Depth is relative to the centre, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.compiling import numba

Image = NDArray[np.float32]

ROWS, COLUMNS = 40, 36
VACANT = np.float32(1e3)  # depth of an empty cell
FIRST_CELL = 2.5  # place of the end of a part, in cells from the border of its image
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


@numba.njit(cache=True, nogil=True)
def fill_middle(points: Any, cell: float, ends: Any, middle: Array) -> None:
    """Move middle (3,) of points (P, 3) so that the end that is in view has its place in the image.

    ends: for columns and rows, 0 to keep the middle, -1 if the lower end is in view, 1 if the upper end is.
    """
    for a in range(2):
        if ends[a] != 0:
            end = points[0, a]
            for i in range(len(points)):
                end = min(end, points[i, a]) if ends[a] < 0 else max(end, points[i, a])
            size = COLUMNS if a == 0 else ROWS
            place = FIRST_CELL if ends[a] < 0 else size - FIRST_CELL
            middle[a] = end - (place - 0.5 * size) * cell


@numba.njit(cache=True, nogil=True)
def fill_part_differences(
    images: Image,
    extents: Indices,
    image: Image,
    known: Mask,
    ends: Any,
    bound: float,
    out: Image,
    steps: Image,
) -> None:
    """Fill out (N,) with the differences of images (N, ROWS, COLUMNS) of whole bodies from that of a part.

    Each is first moved by whole cells and in depth: `steps` (N, 3) columns, rows and metres. In a direction
    with an end in view (`ends`, see `fill_middle`) that end is the same; in any other one the middle of what
    is in view. Only cells that are `known` (ROWS, COLUMNS) count. The difference is that of
    `fill_differences`, divided by the number of cells that are not empty in both images.

    extents (N, 4): first and last column, first and last row that are not empty.
    """
    rows, columns = np.nonzero(image < VACANT)
    count, worst = len(rows), np.float32(bound * bound)
    extent = (columns.min(), columns.max(), rows.min(), rows.max())
    centre_column, centre_row = columns.mean(), rows.mean()
    for n in range(len(images)):
        whole = images[n]
        across, down = 0, 0
        if ends[0] != 0:
            k = 0 if ends[0] < 0 else 1
            across = extent[k] - extents[n, k]
        if ends[1] != 0:
            k = 2 if ends[1] < 0 else 3
            down = extent[k] - extents[n, k]
        if ends[0] == 0 or ends[1] == 0:  # the middle of the band of cells that is in view
            low = [extents[n, 0], extents[n, 2]]
            high = [extents[n, 1], extents[n, 3]]
            if ends[0] != 0:
                low[0], high[0] = max(low[0], extent[0] - across), min(high[0], extent[1] - across)
            if ends[1] != 0:
                low[1], high[1] = max(low[1], extent[2] - down), min(high[1], extent[3] - down)
            total, right, below = 0, 0.0, 0.0
            for r in range(low[1], high[1] + 1):
                for c in range(low[0], high[0] + 1):
                    if whole[r, c] < VACANT:
                        total += 1
                        right += c
                        below += r
            if ends[0] == 0 and total > 0:
                across = int(np.rint(centre_column - right / total))
            if ends[1] == 0 and total > 0:
                down = int(np.rint(centre_row - below / total))
        both, ahead = 0, np.float32(0.0)
        for k in range(count):
            r, c = rows[k] - down, columns[k] - across
            if 0 <= r < ROWS and 0 <= c < COLUMNS and whole[r, c] < VACANT:
                both += 1
                ahead += image[rows[k], columns[k]] - whole[r, c]
        ahead /= np.float32(max(both, 1))
        apart = worst * np.float32(count - both)
        for k in range(count):
            r, c = rows[k] - down, columns[k] - across
            if 0 <= r < ROWS and 0 <= c < COLUMNS and whole[r, c] < VACANT:
                step = image[rows[k], columns[k]] - whole[r, c] - ahead
                apart += min(step * step, worst)
        others = -both  # cells of the body that are known, and empty in the image
        for r in range(max(extents[n, 2], -down), min(extents[n, 3] + 1, ROWS - down)):
            for c in range(max(extents[n, 0], -across), min(extents[n, 1] + 1, COLUMNS - across)):
                others += int(whole[r, c] < VACANT and known[r + down, c + across])
        apart += worst * np.float32(others)
        out[n] = apart / np.float32(count + both + others)
        steps[n, 0], steps[n, 1], steps[n, 2] = across, down, ahead
