"""Gaussian noise of a depth camera, along the line of sight and across it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates

from common.camera import Intrinsics
from coordinator.sensor_noise import SensorNoise

Image = NDArray[np.float64]

FARTHEST = 6.0  # standard deviations that noise ever reaches
SAME_SURFACE = 0.01  # neighbouring depths that differ by less than this share belong to one surface


def add_noise(depth_m: Image, camera: Intrinsics, noise: SensorNoise, rng: np.random.Generator) -> Image:
    """A noisy copy of a depth image (H, W) in metres; 0, where nothing is measured, stays 0.

    Across: each pixel sees the surface where a ray displaced by Gaussian noise meets it, so that
    back-projected points lie off the surface by `noise.lateral` in x and in y, and an outline frays. Along:
    Gaussian noise of standard deviation `noise.depth` on every measured depth.
    """
    noisy = np.zeros_like(depth_m)
    window = reached(depth_m, camera, noise.lateral)
    near = depth_m[window]
    across = rng.standard_normal((2, *near.shape)) * noise.lateral  # metres, (y, x)
    along = rng.standard_normal(near.shape) * noise.depth
    seen = look_aside(near, camera, across) if noise.lateral > 0.0 else near
    noisy[window] = np.where(seen > 0.0, np.maximum(seen + along, 0.0), 0.0)
    return noisy


def reached(depth_m: Image, camera: Intrinsics, lateral: float) -> tuple[slice, slice]:
    """Rows and columns that may see something: what is measured, and as far around as noise reaches."""
    rows, columns = np.flatnonzero(depth_m.any(axis=1)), np.flatnonzero(depth_m.any(axis=0))
    if not len(rows):
        return slice(0), slice(0)
    nearest = depth_m[depth_m > 0.0].min()
    reach = int(np.ceil(FARTHEST * lateral * max(camera.fx, camera.fy) / nearest))
    return slice(max(0, rows[0] - reach), rows[-1] + reach + 1), slice(
        max(0, columns[0] - reach), columns[-1] + reach + 1
    )


def look_aside(depth_m: Image, camera: Intrinsics, across: Image) -> Image:
    """Depth (H, W) that each pixel reads `across` (2, H, W) metres from where it looks.

    How many pixels that is depends on the depth read: it is guessed from the nearest measured pixel's and
    improved once.
    """
    if not depth_m.any():
        return depth_m
    focal = np.array([camera.fy, camera.fx])[:, None, None]
    here = np.indices(depth_m.shape).astype(np.float64)
    reach = depth_m[
        tuple(distance_transform_edt(depth_m <= 0.0, return_distances=False, return_indices=True))
    ]
    first = read(depth_m, here + focal * across / reach)
    reach = np.where(first > 0.0, first, reach)
    return read(depth_m, here + focal * across / reach)


def read(depth_m: Image, pixels: Image) -> Image:
    """Depth at fractional pixels (2, H, W), as (row, column).

    Interpolated within a surface, the nearest pixel's at its edge.
    """
    inverse = np.divide(1.0, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0.0)  # linear on a plane
    nearest = map_coordinates(inverse, np.rint(pixels), order=0)
    between = map_coordinates(inverse, pixels, order=1)
    inside = np.abs(between - nearest) < SAME_SURFACE * nearest
    chosen: Image = np.where(inside, between, nearest)
    return np.divide(1.0, chosen, out=np.zeros_like(chosen), where=chosen > 0.0)
