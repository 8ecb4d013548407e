"""Noise of a depth camera: Gaussian along the line of sight and across it, or that of a Kinect.

A Kinect measures disparity, so its quantisation and its noise grow with the square of the distance.
Khoshelham & Elberink, "Accuracy and resolution of Kinect depth data", Sensors 12 (2012), report a standard
deviation of 1.4 mm and steps of 2.9 mm at 1 m. Nguyen, Izadi & Lovell, "Modeling Kinect sensor noise",
3DIMPVT (2012), report a lateral standard deviation of 0.8 pixels. There is no depth at outlines and on
surfaces seen at a grazing angle.
"""

from __future__ import annotations

import msgspec
import numpy as np
from scipy.ndimage import distance_transform_edt, map_coordinates, maximum_filter, minimum_filter

from gepf.common.arrays import Array
from gepf.common.camera import Intrinsics, back_project
from gepf.coordinator.scene.noise import SensorNoise


class SensorModel(msgspec.Struct, frozen=True):
    """A camera that measures disparity; by default a Kinect."""

    step: float = 2.85e-3  #: of inverse depth, 1/m
    lateral_px: float = 0.8  #: standard deviation across the line of sight
    jump_m: float = 0.03  #: a step in depth, at which half of the pixels have no depth
    grazing_deg: float = 80.0  #: angle between line of sight and normal, beyond which there is no depth


KINECT = SensorModel()


def add_noise(
    depth_m: Array, camera: Intrinsics, noise: SensorNoise, rng: np.random.Generator, *, kinect: bool = False
) -> Array:
    """A noisy copy of a depth image (H, W) in metres; 0 for no depth stays 0.

    Lateral noise: each pixel measures the surface along a ray displaced by Gaussian noise. So back-projected
    points have errors of `noise.lateral` in x and y, and outlines become irregular. Depth noise: Gaussian
    noise with standard deviation `noise.depth` on every depth.
    """
    if kinect:
        depth_m = as_a_kinect(depth_m, camera, rng)
    noisy = np.zeros_like(depth_m)
    window = reached(depth_m, camera, noise.lateral)
    near = depth_m[window]
    across = rng.standard_normal((2, *near.shape)) * noise.lateral  # metres, (y, x)
    along = rng.standard_normal(near.shape) * noise.depth
    seen = look_aside(near, camera, across) if noise.lateral > 0.0 else near
    noisy[window] = np.where(seen > 0.0, np.maximum(seen + along, 0.0), 0.0)
    return noisy


def as_a_kinect(
    depth_m: Array, camera: Intrinsics, rng: np.random.Generator, model: SensorModel = KINECT
) -> Array:
    """Depth (H, W) of a Kinect: noise and quantisation of inverse depth, irregular edges with gaps."""
    beside_a_jump = maximum_filter(depth_m, 3) - minimum_filter(depth_m, 3) > model.jump_m
    kept = ~(beside_a_jump & (rng.random(depth_m.shape) < 0.5))
    kept &= facing(depth_m, camera) > np.cos(np.radians(model.grazing_deg))
    shift = np.indices(depth_m.shape) + model.lateral_px * rng.standard_normal((2, *depth_m.shape))
    seen = read(depth_m * kept, shift)
    steps = np.divide(1.0 / model.step, seen, out=np.zeros_like(seen), where=seen > 0.0)
    steps = np.rint(steps + 0.5 * rng.standard_normal(steps.shape))
    measured = (seen > 0.0) & (steps > 0.0)
    return np.divide(1.0 / model.step, steps, out=np.zeros_like(seen), where=measured)


def facing(depth_m: Array, camera: Intrinsics) -> Array:
    """Cosine (H, W) of the angle between line of sight and normal, from differences of depth."""
    points = back_project(depth_m, camera)
    down, right = np.gradient(points, axis=(0, 1))
    normal = np.cross(down, right)
    length = np.linalg.norm(normal, axis=-1) * np.linalg.norm(points, axis=-1)
    cosine = np.abs(np.sum(normal * points, axis=-1))
    return np.asarray(np.divide(cosine, length, out=np.zeros_like(depth_m), where=length > 0.0))


def reached(depth_m: Array, camera: Intrinsics, lateral: float) -> tuple[slice, slice]:
    """Rows and columns that can have depth: the measured ones, enlarged by the range of the noise."""
    rows, columns = np.flatnonzero(depth_m.any(axis=1)), np.flatnonzero(depth_m.any(axis=0))
    if not len(rows):
        return slice(0), slice(0)
    nearest = depth_m[depth_m > 0.0].min()
    farthest_m = 6.0 * lateral  # six standard deviations, the largest noise
    reach = int(np.ceil(farthest_m * max(camera.fx, camera.fy) / nearest))
    return slice(max(0, rows[0] - reach), rows[-1] + reach + 1), slice(
        max(0, columns[0] - reach), columns[-1] + reach + 1
    )


def look_aside(depth_m: Array, camera: Intrinsics, across: Array) -> Array:
    """Depth (H, W) at `across` (2, H, W) metres from the ray of each pixel.

    The offset in pixels depends on the depth there. It is computed from the depth of the nearest pixel and
    refined once.
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


def read(depth_m: Array, pixels: Array) -> Array:
    """Depth at fractional pixels (2, H, W), as (row, column).

    It is interpolated within a surface, and that of the nearest pixel at its edge.
    """
    inverse = np.divide(1.0, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0.0)  # linear on a plane
    nearest = map_coordinates(inverse, np.rint(pixels), order=0)
    between = map_coordinates(inverse, pixels, order=1)
    inside = np.abs(between - nearest) < 0.01 * nearest  # depths of one surface differ by less than 1 %
    chosen: Array = np.where(inside, between, nearest)
    return np.divide(1.0, chosen, out=np.zeros_like(chosen), where=chosen > 0.0)
