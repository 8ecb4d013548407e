"""The flat part of an object: furniture is made of flat parts, people are not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter

from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics, points_of
from gepf.coordinator.scene.noise import DepthNoise
from gepf.coordinator.scene.planes import count_points, draw_planes, lie_on, refine_best, to_rays
from gepf.coordinator.scene.segmentation import label_parts, measure_components
from gepf.coordinator.settings import SceneSettings


@dataclass(frozen=True, slots=True, eq=False)
class Flat:
    """The plane with the largest part of an object.

    share: part of the object's pixels within half the margin of the plane. on: (H, W) pixels of the object
    that may be on the plane, by their own noise. size: of the squares, pixels. patches: (H, W) for pixels
    around which the surface is on the plane, the visible area of their connected patch, m^2; else 0.
    """

    share: float
    on: Mask
    size: int
    patches: Array

    def grow(self, some: Mask) -> Mask:
        """Some pixels (H, W) of the patches, with those nearby that may be on the plane."""
        return np.asarray(some | (binary_dilation(some, iterations=self.size) & self.on))


def find_flat(
    depth: NDArray[np.floating], mask: Mask, camera: Intrinsics, noise: DepthNoise, settings: SceneSettings
) -> Flat:
    """The flat part of an object with these pixels (H, W) in a depth image (H, W) in metres.

    Each ray is the mean over a square. This reduces the noise, and rays of a plane stay on the plane. So a
    plane can be distinguished from a chest or a back.
    """
    limits = settings.candidates
    size = max(1, int(np.sqrt(limits.min_part_m2) * camera.fx / np.median(depth[mask])))
    points = points_of(depth, camera, mask)
    rays = to_rays(points, noise)
    weight, image = uniform_filter(mask.astype(np.float64), size)[mask], np.zeros(mask.shape)
    averaged = rays.copy()
    for n in range(3):
        image[mask] = rays[:, n]
        averaged[:, n] = uniform_filter(image, size)[mask] / weight
    averaged[:, 3] /= size * np.sqrt(weight)
    some = averaged[:: 1 + len(averaged) // limits.flat_points].copy()
    drawn, flat, on = draw_planes(some, limits.flat_samples), np.zeros_like(mask), np.zeros_like(mask)
    if not len(drawn):  # the object is a line
        return Flat(0.0, on, size, np.zeros(mask.shape))
    planes = refine_best(drawn, count_points(drawn, some)[:, 0], some, settings.planes)
    near = count_points(planes, some)[:, 0]
    plane = planes[near.argmax()]
    flat[mask], on[mask] = lie_on(plane, averaged), lie_on(plane, rays)
    step_m = settings.segmentation.step_m
    labels = label_parts(depth, flat, step_m, step_m, noise, camera.fx)
    areas, _ = measure_components(labels, depth, camera.fx, camera.fy)
    return Flat(float(near.max()) / len(some), on, size, areas[labels])
