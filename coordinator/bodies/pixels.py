"""Which pixels of the foreground show a body rather than a thing.

Furniture touches the people who use it, so steps in depth do not separate them. A small convolutional network
does, a U-Net (O. Ronneberger et al., U-Net: convolutional networks for biomedical image segmentation, MICCAI
2015). It sees the depth around a component of the foreground on an upright grid of 3 cm cells, and which
of them are foreground.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.camera import Intrinsics

Depth = NDArray[np.float32]
Image = NDArray[np.float32]
"""Channels of an image (C, H, W)."""

CELL_M = 0.03
REACH_M = 1.5  # depths are relative to the median of the component, and clipped to it
MIN_CELLS, MAX_CELLS = 80, 160  # along each side of a grid
MARGIN_CELLS = 8  # around the component
POOLED = 8  # sides of a grid are multiples of it: the network halves them three times
MIN_DOWN = 0.1  # less of the direction down is in the image of a camera that looks straight down
BLOCKS = (2, 1, 1)  # convolutions before each pooling
AT_BOTTOM = 2  # convolutions after the last pooling


class Layer(NamedTuple):
    """A convolution of 3 x 3 cells: weights (O, C, 3, 3) and bias (O,)."""

    weights: NDArray[np.float32]
    bias: NDArray[np.float32]


class Grid(NamedTuple):
    """Cells of an image: rows and columns (H, W) of the pixels at their middles, not rounded.

    centre: (2,) the row and column in the middle. to_cells: (2, 2) from rows and columns to cells.
    """

    rows: Array
    columns: Array
    centre: Array
    to_cells: Array

    def cells_of(self, pixels: Indices | Array) -> Indices:
        """The nearest cells (2, P) of pixels (P, 2), rows and columns; those outside get the nearest one."""
        shape = np.array(self.rows.shape)[:, None]
        cells = self.to_cells @ (pixels - self.centre).T + 0.5 * (shape - 1)
        return np.asarray(np.clip(np.rint(cells), 0, shape - 1).astype(np.int64))


@dataclass(frozen=True, slots=True, eq=False)
class BodyNetwork:
    """The network: the convolutions from the image down to the smallest grid and up again, and the last one.

    last: weights (C,) and bias of the log odds of a cell.
    """

    layers: tuple[Layer, ...]
    last: tuple[NDArray[np.float32], float]

    @classmethod
    def load(cls, path: Path) -> BodyNetwork:
        """Read the file of a network: arrays of half precision, two for each layer, in order."""
        with np.load(path) as file:
            arrays = [file[name].astype(np.float32) for name in file.files]
        *layers, last = zip(arrays[::2], arrays[1::2], strict=True)
        return cls(tuple(Layer(*layer) for layer in layers), (last[0].ravel(), float(last[1][0])))

    def probabilities(
        self, depth: Depth, camera: Intrinsics, component: Mask, foreground: Mask, down: Array
    ) -> Depth:
        """How likely pixels of the foreground (H, W) show a body, from 0 to 1; 0 for all other pixels.

        depth: (H, W) metres, 0 where missing. component: (H, W) the pixels around which the grid is. down:
        (2,) the direction in the image, columns and rows, that points down in the room.
        """
        result, inside = np.zeros(depth.shape, np.float32), component & (depth > 0.0)
        if not inside.any():
            return result
        middle_m = float(np.median(depth[inside]))
        grid = grid_around(np.argwhere(inside), CELL_M * camera.fx / middle_m, down)
        of_cells = 0.5 + 0.5 * np.tanh(0.5 * self.log_odds(sample(depth, foreground, grid, middle_m)))
        pixels = np.argwhere(foreground & (depth > 0.0))
        rows, columns = grid.cells_of(pixels)
        result[pixels[:, 0], pixels[:, 1]] = of_cells[rows, columns]
        return result

    def log_odds(self, image: Image) -> Depth:
        """The log odds (H, W) that cells of an image (3, H, W) show a body; see `sample`."""
        layers, kept = iter(self.layers), list[Image]()
        for count in BLOCKS:
            for _ in range(count):
                image = convolve(image, next(layers))
            kept.append(image)
            image = halve(image)
        for _ in range(AT_BOTTOM):
            image = convolve(image, next(layers))
        for layer in layers:
            doubled = image.repeat(2, axis=1).repeat(2, axis=2)
            image = convolve(np.concatenate([doubled, kept.pop()]), layer)
        weights, bias = self.last
        return np.asarray(np.tensordot(weights, image, axes=1) + np.float32(bias))


def grid_around(pixels: Indices, step: float, down: Array) -> Grid:
    """The upright grid around pixels (P, 2), rows and columns, with cells of `step` pixels."""
    row, column = (down[1], down[0]) if np.hypot(*down) > MIN_DOWN else (1.0, 0.0)
    turn = np.array([[row, -column], [column, row]]) / np.hypot(row, column)
    upright = pixels @ turn
    low, high = upright.min(axis=0), upright.max(axis=0)
    sides = np.ceil(((high - low) / step + 2 * MARGIN_CELLS) / POOLED).astype(int) * POOLED
    return grid_at(turn @ (0.5 * (low + high)), step * turn, np.clip(sides, MIN_CELLS, MAX_CELLS))


def grid_at(centre: Array, to_pixels: Array, sides: Indices) -> Grid:
    """The grid with this middle (2,), `to_pixels` (2, 2) from cells to rows and columns, and sides (2,)."""
    high, wide = sides.tolist()
    row, column = np.indices((high, wide)) - 0.5 * (sides[:, None, None] - 1)
    rows, columns = (each[0] * row + each[1] * column for each in to_pixels.tolist())
    return Grid(rows + centre[0], columns + centre[1], centre, np.asarray(np.linalg.inv(to_pixels)))


def sample(depth: Depth, foreground: Mask, grid: Grid, middle_m: float) -> Image:
    """What cells show (3, H, W): depth relative to `middle_m`, whether it is known, whether it is foreground.

    Depth is in metres, clipped, and 0 where it is missing.
    """
    rows, columns = np.rint(grid.rows).astype(int), np.rint(grid.columns).astype(int)
    in_image = (rows >= 0) & (rows < depth.shape[0]) & (columns >= 0) & (columns < depth.shape[1])
    rows, columns = np.where(in_image, rows, 0), np.where(in_image, columns, 0)
    z = np.where(in_image, depth[rows, columns], 0.0)
    known = z > 0.0
    relative = np.where(known, np.clip(z - middle_m, -REACH_M, REACH_M), 0.0)
    return np.stack([relative, known, in_image & foreground[rows, columns]]).astype(np.float32)


def convolve(image: Image, layer: Layer) -> Image:
    """The layer's convolution (O, H, W) of an image (C, H, W), 0 beyond the border, without negative values.

    On the flattened image with a border, each of the nine weights of a channel belongs to one shift. The two
    columns of the border are cut off at the end.
    """
    channels, height, width = image.shape
    wide = width + 2
    bordered = np.zeros((channels, height + 3, wide), np.float32)
    bordered[:, 1 : height + 1, 1 : width + 1] = image
    flat, length = bordered.reshape(channels, -1), height * wide
    kernels = np.ascontiguousarray(layer.weights.transpose(2, 3, 0, 1))  # for fast products
    result = np.repeat(layer.bias[:, None], length, axis=1)
    for row in range(3):
        for column in range(3):
            start = row * wide + column
            result += kernels[row, column] @ flat[:, start : start + length]
    return np.maximum(result.reshape(-1, height, wide)[:, :, :width], 0.0)


def halve(image: Image) -> Image:
    """The largest value of each block of 2 x 2 cells: an image (C, H / 2, W / 2)."""
    channels, height, width = image.shape
    return np.asarray(image.reshape(channels, height // 2, 2, width // 2, 2).max(axis=(2, 4)))
