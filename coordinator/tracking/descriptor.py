"""The descriptor of a body: a coarse orthographic depth image around its centre.

The cells are so large that a few hundred points fill them. So a descriptor can be computed from the vertices
of a model as well as from observed points, at any distance. Depth is also relative to the centre.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.compiling import numba

Image = NDArray[np.float32]
ROWS, COLUMNS = 40, 36
VACANT = np.float32(1e3)  # depth of an empty cell
END_MARGIN_CELLS = 2.5  # where the visible end of a truncated body is placed, in cells from the border


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
    """Write to `out` (N,) the differences of descriptors from an image: the sum of min(|dz|, bound)^2.

    cells: Descriptors (ROWS * COLUMNS, N). occupied: (N,) number of non-empty cells of each descriptor.
    """
    worst, depths, zero = np.float32(bound * bound), image.ravel(), np.float32(0.0)
    for n in range(len(out)):
        # a cell that is empty in one of the two counts as bound^2; begin with all cells of the descriptor
        out[n] = worst * occupied[n]
    for k in range(len(depths)):
        if depths[k] < VACANT:
            line, depth = cells[k], depths[k]
            for n in range(len(out)):
                apart = line[n] - depth
                already_counted = worst if line[n] < VACANT else zero
                out[n] += min(apart * apart, worst) - already_counted


@numba.njit(cache=True, nogil=True)
def move_middle(points: Any, cell: float, ends: Any, middle: Array) -> None:
    """Move middle (3,) of points (P, 3) so that the visible end is `END_MARGIN_CELLS` from the border.

    ends: for columns and rows, 0 to keep the middle, -1 if the end with the smallest coordinate is in view, 1
    if that with the largest is (in rows: the bottom).
    """
    for a in range(2):
        if ends[a] != 0:
            end = points[0, a]
            for i in range(len(points)):
                end = min(end, points[i, a]) if ends[a] < 0 else max(end, points[i, a])
            size = COLUMNS if a == 0 else ROWS
            place = END_MARGIN_CELLS if ends[a] < 0 else size - END_MARGIN_CELLS
            middle[a] = end - (place - 0.5 * size) * cell


class Cells(NamedTuple):
    """The cells of descriptors (N) that are not empty, one descriptor after another."""

    offsets: Indices  # (N + 1,) start of the cells of each descriptor
    row: NDArray[np.int16]
    column: NDArray[np.int16]
    depth: NDArray[np.float32]
    extents: Indices  # (N, 4): first and last column, first and last row


def cells_of(images: Image) -> Cells:
    """The cells of descriptors (N, ROWS, COLUMNS)."""
    owner, row, column = np.nonzero(images < VACANT)
    offsets = np.searchsorted(owner, np.arange(len(images) + 1))
    reducers = (np.minimum.reduceat, np.maximum.reduceat)
    ends = [reduced(places, offsets[:-1]) for places in (column, row) for reduced in reducers]
    places = row.astype(np.int16), column.astype(np.int16)
    return Cells(offsets, *places, images[owner, row, column], np.stack(ends, axis=1))


@numba.njit(cache=True, nogil=True)
def compare_part(cells: Cells, image: Image, in_view: Mask, ends: Any, bound: float) -> tuple[Image, Array]:
    """Differences (N,) of whole bodies from the image of a part, and the steps (N, 3) that align them.

    Each body is first moved by whole cells (columns, rows) and in depth, metres. Along an axis with
    a visible end (`ends`, see `move_middle`), these ends are aligned; along other axes, the centres of the
    visible cells. Only cells that are `in_view` (ROWS, COLUMNS) count. The difference is the sum of
    `fill_differences`, divided by the number of non-empty cells in the one image plus that in the other.
    """
    rows, columns = np.nonzero(image < VACANT)
    part_extent = np.array([columns.min(), columns.max(), rows.min(), rows.max()])
    centre = np.array([np.mean(columns), np.mean(rows)])
    depths = np.full((3 * ROWS, 3 * COLUMNS), VACANT, dtype=np.float32)  # a moved body stays inside
    depths[ROWS : 2 * ROWS, COLUMNS : 2 * COLUMNS] = image
    visible = np.zeros(depths.shape, dtype=np.int64)
    visible[ROWS : 2 * ROWS, COLUMNS : 2 * COLUMNS] = in_view
    count, worst = len(cells.extents), np.float32(bound * bound)
    differences, steps = np.empty(count, dtype=np.float32), np.empty((count, 3))
    apart = np.empty(ROWS * COLUMNS, dtype=np.float32)
    for n in range(count):
        across, down = align_part(cells, n, part_extent, centre, ends)
        shared, filled, depth_step = 0, 0, np.float32(0.0)
        for k in range(cells.offsets[n], cells.offsets[n + 1]):
            r, c = ROWS + cells.row[k] + down, COLUMNS + cells.column[k] + across
            filled += visible[r, c]
            if depths[r, c] < VACANT:
                apart[shared] = depths[r, c] - cells.depth[k]
                depth_step += apart[shared]
                shared += 1
        depth_step /= np.float32(max(shared, 1))
        # cells that are empty in one of the two images
        total = worst * np.float32(len(rows) + filled - 2 * shared)
        for k in range(shared):
            total += min((apart[k] - depth_step) * (apart[k] - depth_step), worst)
        differences[n] = total / np.float32(len(rows) + filled)
        steps[n, 0], steps[n, 1], steps[n, 2] = across, down, depth_step
    return differences, steps


@numba.njit(cache=True, nogil=True)
def align_part(cells: Cells, n: int, part_extent: Indices, centre: Array, ends: Any) -> tuple[int, int]:
    """The step, in columns and rows, from the image of the n-th whole body to that of a part.

    part_extent: first and last column, first and last row of the part. centre: its mean column and row.
    """
    extent = cells.extents[n]
    step = [0, 0]
    low, high = [extent[0], extent[2]], [extent[1], extent[3]]  # of the band of the body that is in view
    for a in range(2):
        if ends[a] != 0:
            k = 2 * a + int(ends[a] > 0)
            step[a] = part_extent[k] - extent[k]
            low[a] = max(low[a], part_extent[2 * a] - step[a])
            high[a] = min(high[a], part_extent[2 * a + 1] - step[a])
    if ends[0] != 0 and ends[1] != 0:
        return step[0], step[1]
    count, right, below = 0, 0, 0
    for k in range(cells.offsets[n], cells.offsets[n + 1]):
        r, c = cells.row[k], cells.column[k]
        if low[1] <= r <= high[1] and low[0] <= c <= high[0]:
            count += 1
            right += c
            below += r
    if count == 0:
        return step[0], step[1]
    across = step[0] if ends[0] != 0 else int(np.rint(centre[0] - right / count))
    return across, step[1] if ends[1] != 0 else int(np.rint(centre[1] - below / count))
