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
Whole = tuple[Image, Indices]
"""Images (N, ROWS, COLUMNS) of whole bodies, and their extents (N, 4): first and last column, first and last
row that are not empty."""

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
def move_middle(points: Any, cell: float, ends: Any, middle: Array) -> None:
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
def compare_part(whole: Whole, image: Image, known: Mask, ends: Any, bound: float) -> tuple[Image, Array]:
    """Differences (N,) of whole bodies from the image of a part, and the steps (N, 3) that align them.

    Each body is first moved by whole cells (columns, rows) and in depth, metres. In a direction with an end
    in view (`ends`, see `move_middle`) that end is the same; in another one the middle of what is in view.
    Only cells that are `known` (ROWS, COLUMNS) count. The difference is the sum of `fill_differences`,
    divided by the number of cells that are not empty in both images.
    """
    images, extents = whole
    rows, columns = np.nonzero(image < VACANT)
    extent = np.array([columns.min(), columns.max(), rows.min(), rows.max()])
    centre = np.array([np.mean(columns), np.mean(rows)])
    differences, steps = np.empty(len(images), dtype=np.float32), np.empty((len(images), 3))
    for n in range(len(images)):
        across, down = align_part(images[n], extents[n], extent, centre, ends)
        both, ahead = 0, 0.0
        for k in range(len(rows)):
            depth = look_up(images[n], rows[k] - down, columns[k] - across)
            if depth < VACANT:
                both += 1
                ahead += image[rows[k], columns[k]] - depth
        ahead /= max(both, 1)
        apart = 0.0
        for k in range(len(rows)):
            depth = look_up(images[n], rows[k] - down, columns[k] - across)
            if depth < VACANT:
                apart += min((image[rows[k], columns[k]] - depth - ahead) ** 2, bound * bound)
        filled = count_known(images[n], extents[n], known, across, down)
        apart += bound * bound * (len(rows) + filled - 2 * both)
        differences[n] = apart / (len(rows) + filled)
        steps[n, 0], steps[n, 1], steps[n, 2] = across, down, ahead
    return differences, steps


@numba.njit(cache=True, nogil=True)
def look_up(body: Image, row: int, column: int) -> Any:
    """The depth in a cell, VACANT outside of the image."""
    return body[row, column] if 0 <= row < ROWS and 0 <= column < COLUMNS else VACANT


@numba.njit(cache=True, nogil=True)
def count_known(body: Image, extent: Indices, known: Mask, across: int, down: int) -> int:
    """Number of cells of a body, moved by whole cells, that are not empty and that are known."""
    count = 0
    for r in range(max(extent[2], -down), min(extent[3] + 1, ROWS - down)):
        for c in range(max(extent[0], -across), min(extent[1] + 1, COLUMNS - across)):
            count += int(body[r, c] < VACANT and known[r + down, c + across])
    return count


@numba.njit(cache=True, nogil=True)
def align_part(body: Image, extent: Indices, shown: Indices, centre: Array, ends: Any) -> tuple[int, int]:
    """The steps, columns and rows, from the image of a whole body to that of a part.

    extent, shown: first and last column, first and last row of the two that are not empty. centre: mean
    column and row of the part.
    """
    step: Indices = np.zeros(2, dtype=np.int64)
    low, high = extent[::2].copy(), extent[1::2].copy()  # of the band of the body that is in view
    for a in range(2):
        if ends[a] != 0:
            k = 2 * a + int(ends[a] > 0)
            step[a] = shown[k] - extent[k]
            low[a] = max(low[a], shown[2 * a] - step[a])
            high[a] = min(high[a], shown[2 * a + 1] - step[a])
    count, sums = 0, np.zeros(2)
    for r in range(low[1], high[1] + 1):
        for c in range(low[0], high[0] + 1):
            if body[r, c] < VACANT:
                count += 1
                sums[0] += c
                sums[1] += r
    for a in range(2):
        if ends[a] == 0 and count > 0:
            step[a] = int(np.rint(centre[a] - sums[a] / count))
    return int(step[0]), int(step[1])
