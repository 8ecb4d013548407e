"""The flat part of an object: furniture is made of flat parts, people are not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, uniform_filter

from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics, points_of
from gepf.coordinator.scene.noise import DepthNoise
from gepf.coordinator.scene.planes import count_rays, draw_planes, lie_on, refine_best, to_rays
from gepf.coordinator.scene.segmentation import label_parts, measure_components
from gepf.coordinator.settings import SceneSettings


@dataclass(frozen=True, slots=True, eq=False)
class FlatPart:
    """The plane that contains the largest part of an object.

    share: share of the object's pixels within half the margin of the plane. on_plane: (H, W) pixels of the
    object whose individual measurements, within noise, are consistent with the plane. size: side of the
    averaging square, in pixels. patch_areas: (H, W) visible area, in m^2, of the connected flat patch that a
    pixel belongs to; 0 if it belongs to none.
    """

    share: float
    on_plane: Mask
    size: int
    patch_areas: Array

    def grow(self, pixels: Mask) -> Mask:
        """The given `pixels` (H, W) of patches, extended by nearby pixels consistent with the plane."""
        return np.asarray(pixels | (binary_dilation(pixels, iterations=self.size) & self.on_plane))


def find_flat_part(
    depth: NDArray[np.floating], mask: Mask, camera: Intrinsics, noise: DepthNoise, settings: SceneSettings
) -> FlatPart:
    """The flat part of an object with these pixels (H, W) in a depth image (H, W) in metres.

    Each ray is averaged over a square, which reduces the noise but keeps the rays of a plane on it. So a
    plane can be distinguished from a chest or a back.
    """
    limits = settings.candidates
    size = max(1, int(np.sqrt(limits.min_part_m2) * camera.fx / np.median(depth[mask])))
    points = points_of(depth, camera, mask)
    rays = to_rays(points, noise)
    weight = uniform_filter(mask.astype(np.float64), size)[mask]
    image = np.zeros(mask.shape)
    averaged = rays.copy()
    for n in range(3):
        image[mask] = rays[:, n]
        averaged[:, n] = uniform_filter(image, size)[mask] / weight
    averaged[:, 3] /= size * np.sqrt(weight)
    sampled_rays = averaged[:: 1 + len(averaged) // limits.flat_points].copy()
    drawn = draw_planes(sampled_rays, limits.flat_samples)
    flat, on_plane = np.zeros_like(mask), np.zeros_like(mask)
    if not len(drawn):  # the object is a line
        return FlatPart(0.0, on_plane, size, np.zeros(mask.shape))
    planes = refine_best(drawn, count_rays(drawn, sampled_rays)[:, 0], sampled_rays, settings.planes)
    near = count_rays(planes, sampled_rays)[:, 0]
    plane = planes[near.argmax()]
    flat[mask], on_plane[mask] = lie_on(plane, averaged), lie_on(plane, rays)
    step_m = settings.segmentation.step_m
    labels = label_parts(depth, flat, step_m, step_m, noise, camera.fx)
    areas, _ = measure_components(labels, depth, camera.fx, camera.fy)
    return FlatPart(float(near.max()) / len(sampled_rays), on_plane, size, areas[labels])
