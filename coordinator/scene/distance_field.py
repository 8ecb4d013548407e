"""How far points are from a posed body, by a grid of cells around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from coordinator.scene.geometry import Array, Depth, Lens

Squares = NDArray[np.uint8]

CELL_M = 0.04
FARTHEST_CELLS = 8  # what is farther from the surface counts as so far
BEYOND = FARTHEST_CELLS**2


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField:
    """Squared distances in cells from a surface, in a grid that begins at `low`."""

    low: Array  # (3,) metres, camera frame
    squares: Squares  # (X, Y, Z), BEYOND at the most

    @classmethod
    def around(cls, surface: Array) -> DistanceField:
        """The field around the points (V, 3) of a surface, metres, spread along one axis after another."""
        margin = FARTHEST_CELLS * CELL_M
        low = surface.min(axis=0) - margin
        shape = tuple((np.ceil((surface.max(axis=0) + margin - low) / CELL_M).astype(np.int64) + 1).tolist())
        squares = np.full(shape, BEYOND, dtype=np.uint8)
        squares[tuple(((surface - low) / CELL_M).astype(np.int64).T)] = 0
        flat = squares.ravel()
        for stride in (1, shape[2], shape[1] * shape[2]):  # the margin keeps lines of the grid apart
            before = flat.copy()
            for step in range(1, FARTHEST_CELLS):
                shift, more = step * stride, np.uint8(step * step)
                np.minimum(flat[:-shift], before[shift:] + more, out=flat[:-shift])
                np.minimum(flat[shift:], before[:-shift] + more, out=flat[shift:])
        return cls(low, np.minimum(squares, np.uint8(BEYOND)))

    def measure(self, depth: Depth, lens: Lens) -> Squares:
        """Squared distances (H, W) in cells of the points that a depth image in metres shows."""
        squares = np.empty(depth.shape, dtype=np.uint8)
        measure_pixels(depth, lens, self.low, self.squares, squares)
        return squares

    def meets(self, other: DistanceField) -> bool:
        """Whether anything may be near to both surfaces."""
        highest = [each.low + CELL_M * np.array(each.squares.shape) for each in (self, other)]
        return bool(np.all(self.low < highest[1]) and np.all(other.low < highest[0]))


def squared_cells(metres: float) -> float:
    """A distance as a field gives it."""
    return (metres / CELL_M) ** 2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def measure_pixels(depth: Depth, lens: Lens, low: Array, grid: Squares, squares: Squares) -> None:
    """Fill squares (H, W) as `DistanceField.measure` says; BEYOND where nothing was measured."""
    fx, fy, cx, cy = lens
    nearest, farthest = low[2], low[2] + CELL_M * grid.shape[2]
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            squares[v, u] = BEYOND
            if not (z > 0.0 and nearest <= z < farthest):
                continue
            x, y = (u - cx) / fx * z - low[0], (v - cy) / fy * z - low[1]
            i, j, k = int(x / CELL_M), int(y / CELL_M), int((z - low[2]) / CELL_M)
            if x >= 0.0 and y >= 0.0 and i < grid.shape[0] and j < grid.shape[1] and k < grid.shape[2]:
                squares[v, u] = grid[i, j, k]
