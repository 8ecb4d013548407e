"""What a camera would see of the model: samples of its surface on a grid of pixels, each with its link."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.surface import Surface
from worker.kernel.visibility import (
    LARGEST_SIDE,
    NEAR,
    PIXEL,
    VisibilityBuffers,
    faces_camera,
    project_vertices,
)

Array = NDArray[np.float64]


MARGIN = 12  # pixels around the model in which nothing is


class SampleBuffers(NamedTuple):
    """Buffers for samples."""

    depth: NDArray[np.float32]  # (LARGEST_SIDE ** 2,)
    links: NDArray[np.int32]  # (LARGEST_SIDE ** 2,)


class SampleGrid(NamedTuple):
    """Samples of one pose: that of row r and column c lies on the ray through (c + left, r + top, focal)."""

    depth: NDArray[np.float32]  # (H, W) metres, infinite where the model is not seen
    links: NDArray[np.int32]  # (H, W)
    left: int
    top: int
    focal: float  # pixels


def make_sample_buffers() -> SampleBuffers:
    """Allocate buffers for samples of any pose."""
    return SampleBuffers(
        np.empty(LARGEST_SIDE * LARGEST_SIDE, dtype=np.float32),
        np.empty(LARGEST_SIDE * LARGEST_SIDE, dtype=np.int32),
    )


@numba.njit(cache=True, nogil=True)
def sample(view: VisibilityBuffers, surface: Surface, pixel: float, samples: SampleBuffers) -> SampleGrid:
    """Samples of the surface as view.posed has it, every `pixel` metres at the body's mean distance."""
    posed, image, triangles = view.posed, view.image, surface.triangles
    shrink = PIXEL / pixel
    left, top, right, bottom = project_vertices(posed, image)
    image *= shrink
    left, top = int(np.floor(left * shrink)) - MARGIN, int(np.floor(top * shrink)) - MARGIN
    right, bottom = int(np.ceil(right * shrink)) + MARGIN, int(np.ceil(bottom * shrink)) + MARGIN
    width, height = min(LARGEST_SIDE, right - left + 1), min(LARGEST_SIDE, bottom - top + 1)
    grid = SampleGrid(
        samples.depth[: height * width].reshape(height, width),
        samples.links[: height * width].reshape(height, width),
        left,
        top,
        float(np.mean(posed[:, 2])) / pixel,
    )
    grid.depth[:] = np.inf
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        if faces_camera(image, a, b, c) and min(posed[a, 2], posed[b, 2], posed[c, 2]) > NEAR:
            sample_triangle(image, posed, a, b, c, surface.skin_links[a, 0], grid)
    grid.depth[:MARGIN] = grid.depth[height - MARGIN :] = np.inf
    grid.depth[:, :MARGIN] = grid.depth[:, width - MARGIN :] = np.inf
    return grid


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sample_triangle(image: Array, posed: Array, a: int, b: int, c: int, link: int, grid: SampleGrid) -> None:
    """Put the triangle into the grid wherever it covers a pixel's centre and nothing is nearer."""
    ax, ay = image[a, 0] - grid.left, image[a, 1] - grid.top
    bx, by = image[b, 0] - grid.left - ax, image[b, 1] - grid.top - ay  # from a
    cx, cy = image[c, 0] - grid.left - ax, image[c, 1] - grid.top - ay
    depth, links = grid.depth, grid.links
    first_column = max(0, int(np.ceil(ax + min(0.0, bx, cx))))
    last_column = min(depth.shape[1] - 1, int(np.floor(ax + max(0.0, bx, cx))))
    first_row = max(0, int(np.ceil(ay + min(0.0, by, cy))))
    last_row = min(depth.shape[0] - 1, int(np.floor(ay + max(0.0, by, cy))))
    if first_column > last_column or first_row > last_row:
        return
    scale = 1.0 / (bx * cy - by * cx)
    z, zb, zc = posed[a, 2], posed[b, 2] - posed[a, 2], posed[c, 2] - posed[a, 2]
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            x, y = column - ax, row - ay
            wb, wc = (x * cy - y * cx) * scale, (bx * y - by * x) * scale
            here = np.float32(z + wb * zb + wc * zc)
            if wb >= -1e-9 and wc >= -1e-9 and wb + wc <= 1.0 + 1e-9 and here < depth[row, column]:
                depth[row, column] = here
                links[row, column] = link
