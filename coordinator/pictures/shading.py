"""Depth images to look at: lit over the viewer's left shoulder, near things brighter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from common.camera import Intrinsics

Pixels = NDArray[np.float32]

LIGHT = (-0.35, -0.55, -0.76)  # towards the light, camera frame
FAR_COLOUR = np.array([118.0, 132.0, 154.0], dtype=np.float32)
NEAR_COLOUR = np.array([250.0, 250.0, 250.0], dtype=np.float32)
AMBIENT = 0.3
NOISY_M, SMOOTHEST = 0.01, 6.0  # noise for which one pixel of averaging does; most pixels ever


def shade_depth(depth_m: Pixels, camera: Intrinsics) -> Pixels:
    """Colours (H, W, 3), 0-255, of observed depth (H, W); black where nothing was measured."""
    seen = depth_m > 0.0
    if not seen.any():
        return np.zeros((*depth_m.shape, 3), dtype=np.float32)
    near, far = np.percentile(depth_m[seen], [2, 98])
    nearness = np.clip((far - depth_m) / max(far - near, 1e-6), 0.0, 1.0)[..., None]
    light = AMBIENT + (1.0 - AMBIENT) * lambert(blur(depth_m, smoothing(depth_m)), camera)
    colours: Pixels = (FAR_COLOUR + (NEAR_COLOUR - FAR_COLOUR) * nearness) * (light * seen)[..., None]
    return colours


def lambert(depth_m: Pixels, camera: Intrinsics) -> Pixels:
    """How much light (H, W), 0-1, falls on a surface given by its depth; 0 where there is none.

    The normal of z(u, v) is (fx z_u, fy z_v, -(z + (u - cx) z_u + (v - cy) z_v)), towards the camera.
    """
    z_v, z_u = np.gradient(depth_m)
    v, u = np.ogrid[: depth_m.shape[0], : depth_m.shape[1]]
    u, v = (u - camera.cx).astype(np.float32), (v - camera.cy).astype(np.float32)
    x, y, z = camera.fx * z_u, camera.fy * z_v, -(depth_m + u * z_u + v * z_v)
    length = np.sqrt(x * x + y * y + z * z)
    cosine = (LIGHT[0] * x + LIGHT[1] * y + LIGHT[2] * z) / np.maximum(length, np.float32(1e-9))
    light: Pixels = np.where(depth_m > 0.0, np.clip(cosine, 0.0, 1.0), 0.0).astype(np.float32)
    return light


def smoothing(depth_m: Pixels) -> float:
    """Standard deviation in pixels over which depth as noisy as this is to be averaged before lighting."""
    before, here, after = depth_m[:, :-2], depth_m[:, 1:-1], depth_m[:, 2:]
    bend = (before - 2.0 * here + after)[(before > 0.0) & (here > 0.0) & (after > 0.0)]
    noise = float(np.median(np.abs(bend))) / (0.6745 * np.sqrt(6.0)) if bend.size else 0.0
    return float(np.clip(noise / NOISY_M, 1.0, SMOOTHEST))


def blur(depth_m: Pixels, sigma: float) -> Pixels:
    """Gaussian average over measured depth only; 0 stays 0."""
    seen = depth_m > 0.0
    weight = gaussian_filter(seen.astype(np.float32), sigma)
    total = gaussian_filter(depth_m, sigma)
    return np.where(seen, total / np.maximum(weight, np.float32(1e-6)), np.float32(0.0))


def contours(depth_m: Pixels, jump_m: float) -> NDArray[np.bool_]:
    """Pixels (H, W) of the surface at its outline, and on the near side of steps in depth."""
    there = np.where(depth_m > 0.0, depth_m, np.float32(np.inf))
    edge = np.zeros(depth_m.shape, dtype=bool)
    edge[:, :-1] |= there[:, 1:] > there[:, :-1] + jump_m
    edge[:, 1:] |= there[:, :-1] > there[:, 1:] + jump_m
    edge[:-1] |= there[1:] > there[:-1] + jump_m
    edge[1:] |= there[:-1] > there[1:] + jump_m
    return edge
