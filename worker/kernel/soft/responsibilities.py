"""Soft correspondences: under heavy noise an observed point may come from any visible sample around it.

The closest model point is not where a noisy point comes from: it lies the nearer, the more choice there is,
so limbs are drawn into what lies beside them. Here a pixel's measurement is what the camera does: it looks
somewhere near its own ray and errs along it. With samples x_k of the visible surface, p_i is distributed as

    p(p_i) = sum_k a_k / (2 pi s^2) exp(-1/2 (|across(p_i - x_k)|^2 / s^2 + along(p_i - x_k)^2 / t^2)) + e

with s and t the standard deviations across and along the ray, across(p_i - x_k) what the ray passes the
sample by at the sample's depth, a_k the area of a sample, which stands for the same solid angle at any
depth, and e what is left for outliers. A sample's responsibility for the point is g_ik = p_k(p_i) / p(p_i).
All is in units of s^2, as the hard correspondences are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.observation import BLOCK
from worker.kernel.packing import KernelParameters, PackedObservation
from worker.kernel.soft.samples import SampleGrid
from worker.kernel.visibility import PIXEL

Array = NDArray[np.float64]
Points = NDArray[np.float32]
Indices = NDArray[np.int64]

SEARCH_DEVIATIONS = 2.5  # standard deviations across, within which samples are sought
LARGEST_RADIUS = 3  # pixels that this is at the most; samples are as far apart as it takes
SIDE = 2 * LARGEST_RADIUS + 1
OUTLIER_DENSITY = 1e-3  # e, where a point amid a surface, exactly on it, has 1
FAR = np.float32(1e4)  # metres: farther than any sample
VECTORISED = {"reassoc", "contract", "nsz"}  # the compiler may sum up lane by lane


class Rays(NamedTuple):
    """Observed points of a block as the camera measured them."""

    right: Array  # (BLOCK,) of the ray, for each metre of depth
    down: Array
    depth: Points  # metres
    column: Indices  # of the first sample around the point
    row: Indices
    place: NDArray[np.uint32]  # of that sample, among all


class SoftBuffers(NamedTuple):
    """Buffers for the samples of a block of points, and for one point's wrench on each link."""

    rays: Rays
    across: Points  # (2, SIDE, BLOCK) squared samples by which a ray passes by columns and rows
    densities: Points  # (SIDE ** 2, BLOCK) p_k(p_i), samples row by row
    totals: Points  # (BLOCK,) their sums
    wrenches: Array  # (L, 6) force, and torque about the camera
    links: Indices  # (L,) that the point acts on
    touched: NDArray[np.bool_]  # (L,)
    score: Array  # (D,)


def make_soft_buffers(dofs: int, links: int) -> SoftBuffers:
    """Allocate buffers for a body of so many degrees of freedom and links."""
    return SoftBuffers(
        Rays(
            np.empty(BLOCK),
            np.empty(BLOCK),
            np.empty(BLOCK, dtype=np.float32),
            np.empty(BLOCK, dtype=np.int64),
            np.empty(BLOCK, dtype=np.int64),
            np.empty(BLOCK, dtype=np.uint32),
        ),
        np.empty((2, SIDE, BLOCK), dtype=np.float32),
        np.empty((SIDE * SIDE, BLOCK), dtype=np.float32),
        np.empty(BLOCK, dtype=np.float32),
        np.empty((links, 6)),
        np.empty(links, dtype=np.int64),
        np.zeros(links, dtype=np.bool_),
        np.empty(dofs),
    )


@numba.njit(cache=True, nogil=True)
def sample_distance(parameters: KernelParameters) -> float:
    """Metres between samples."""
    return max(PIXEL, SEARCH_DEVIATIONS * parameters.noise_lateral / LARGEST_RADIUS)


@numba.njit(cache=True, nogil=True)
def sample_radius(parameters: KernelParameters) -> int:
    """Pixels around a point within which its samples are sought."""
    return min(
        LARGEST_RADIUS, int(SEARCH_DEVIATIONS * parameters.noise_lateral / sample_distance(parameters) + 0.5)
    )


@numba.njit(cache=True, nogil=True)
def compute_responsibilities(
    first: int,
    grid: SampleGrid,
    observed: PackedObservation,
    parameters: KernelParameters,
    radius: int,
    buffers: SoftBuffers,
) -> None:
    """Fill buffers.rays, .densities and .totals for the block of points from the first on.

    The responsibility g_ik is densities / (totals + OUTLIER_DENSITY). Points beside the grid have density 0.
    """
    ray_residuals(observed.points, first, parameters.stretch, radius, grid, buffers.rays, buffers.across)
    for axis in range(2):
        square_residuals(axis, 2 * radius + 1, buffers.across)
    gather_depths(
        grid.depth.ravel(), grid.depth.shape[1], 2 * radius + 1, buffers.rays.place, buffers.densities
    )
    sample_densities(
        2 * radius + 1,
        np.float32(1.0 / (grid.focal * parameters.noise_lateral) ** 2),
        np.float32(-0.5 / parameters.noise_depth**2),
        buffers.rays.depth,
        buffers.across,
        buffers.densities,
        buffers.totals,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def ray_residuals(
    points: Points, first: int, stretch: float, radius: int, grid: SampleGrid, rays: Rays, across: Points
) -> None:
    """Fill rays, and across[:, 0] with each ray's residual from the first sample around it, in samples.

    What is beside the grid is held against its corner, where there are none.
    """
    depth, width, height = grid.depth, grid.depth.shape[1] - 2 * radius, grid.depth.shape[0] - 2 * radius
    focal, left, top = grid.focal, grid.left, grid.top
    right, down, depths, columns, rows, place = rays
    for i in range(BLOCK):
        z = points[2, first + i] / stretch
        right[i], down[i], depths[i] = points[0, first + i] / z, points[1, first + i] / z, z
        u, v = focal * right[i] - left, focal * down[i] - top
        column, row = int(np.floor(u + 0.5)) - radius, int(np.floor(v + 0.5)) - radius
        inside = 0 <= row < height and 0 <= column < width
        row, column = (row, column) if inside else (0, 0)
        columns[i], rows[i], place[i] = column, row, row * depth.shape[1] + column
        across[0, 0, i], across[1, 0, i] = (column - u, row - v) if inside else (0.0, 0.0)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=VECTORISED)
def square_residuals(axis: int, side: int, across: Points) -> None:
    """Turn across[axis, 0] into across[axis, :side]: squared residuals from each sample on."""
    for k in range(side - 1, -1, -1):
        for i in range(BLOCK):
            x = across[axis, 0, i] + np.float32(k)
            across[axis, k, i] = x * x


@numba.njit(cache=True, nogil=True)
def gather_depths(
    samples: Points, width: int, side: int, place: NDArray[np.uint32], densities: Points
) -> None:
    """Fill densities (side ** 2, BLOCK) with the depths of the samples from each place on, row by row.

    No sample is one that is far.
    """
    for r in range(side):
        for c in range(side):
            for i in range(BLOCK):
                densities[r * side + c, i] = min(samples[place[i] + np.uint32(r * width + c)], FAR)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath=VECTORISED)
def sample_densities(
    side: int,
    areas: np.float32,
    exponent: np.float32,
    depth: Points,
    across: Points,
    densities: Points,
    totals: Points,
) -> None:
    """Turn densities from samples' depths into p_k(p_i); totals takes the sums over k.

    `areas` is a sample's area (in units of s^2) for a squared metre of depth.
    """
    totals[:] = 0.0
    for r in range(side):
        for c in range(side):
            for i in range(BLOCK):
                z = densities[r * side + c, i]
                away, area = depth[i] - z, areas * z * z if z < FAR else np.float32(0.0)
                squares = across[0, c, i] + across[1, r, i]
                passing = decay(exponent * away * away - np.float32(0.5) * area * squares)
                density = np.float32(0.15915494309) * area * passing
                densities[r * side + c, i] = density
                totals[i] += density


@numba.njit(cache=True, nogil=True, inline="always")
def decay(x: np.float32) -> np.float32:
    """exp(x) of x <= 0 to 1e-4 of itself, 0 below -16, without a branch: Taylor's series of x / 64."""
    y = max(x, np.float32(-16.0)) * np.float32(1.0 / 64.0)
    e = np.float32(1.0 / 120.0) * y + np.float32(1.0 / 24.0)
    e = e * y + np.float32(1.0 / 6.0)
    e = e * y + np.float32(0.5)
    e = e * y + np.float32(1.0)
    e = e * y + np.float32(1.0)
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e if x > np.float32(-16.0) else np.float32(0.0)
