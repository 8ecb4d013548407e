"""The permanence of what each pixel shows, for a stationary camera.

Permanence is the share of the recent time for which nothing behind the present surface was visible. It is
small for what has moved: an arm in front of a wall that was visible a moment ago. It is 1 for what has been
there since the first frame: a person who sits still, or the chair. Only the farthest surface of a pixel and
the share of the time for which it was visible are stored. Before its first depth, a pixel counts as having
shown something behind it. Occupancy grids (Moravec and Elfes, 1985) accumulate the same evidence in cells of
space.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.compiling import numba
from gepf.coordinator.scene.noise import DepthNoise, margin_at

Depth = NDArray[np.float32]
Shares = NDArray[np.uint16]  # from 0 to ALWAYS
Window = tuple[int, int, int, int]  # left, top, right, bottom in pixels, half-open

ALWAYS = 65_535
FORGOTTEN = ALWAYS // 100
"""Below this share, a surface that is not visible no longer counts as part of the scene."""


class Occupancy(NamedTuple):
    """What the pixels (H, W) showed until now.

    farthest: the farthest depth, metres; 0 if none was measured. shown: the share of the time for which it
    was visible.
    """

    farthest: Depth
    shown: Shares

    @classmethod
    def unknown(cls, shape: tuple[int, ...]) -> Occupancy:
        """The occupancy before the first image, for images of this shape (H, W)."""
        return cls(np.zeros(shape, np.float32), np.zeros(shape, np.uint16))


class OccupancyChange(NamedTuple):
    """The change by one image: flat indices (N,) of pixels, and their new values."""

    pixels: NDArray[np.uint32]
    farthest: Depth
    shown: Shares

    @classmethod
    def of(cls, occupancy: Occupancy, pixels: NDArray[np.uint32]) -> OccupancyChange:
        """The present values of these pixels (N,)."""
        return cls(pixels, occupancy.farthest.ravel()[pixels], occupancy.shown.ravel()[pixels])

    def apply(self, occupancy: Occupancy) -> None:
        """Set the new values."""
        occupancy.farthest.ravel()[self.pixels] = self.farthest
        occupancy.shown.ravel()[self.pixels] = self.shown


@numba.njit(cache=True, nogil=True, error_model="numpy")
def accumulate(depth: Depth, noise: DepthNoise, occupancy: Occupancy, weight: float) -> NDArray[np.uint32]:
    """Add a depth image (H, W) in place; returns the flat indices (N,) of the changed pixels.

    `weight` is the part of the time that the image stands for.
    """
    farthest, shown = occupancy.farthest, occupancy.shown
    pixels = np.empty(depth.size, dtype=np.uint32)
    count = 0
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z, last_share = depth[v, u], shown[v, u]
            margin = margin_at(z, noise)
            if not z > 0.0 or (last_share == ALWAYS and abs(z - farthest[v, u]) < margin):
                continue
            if z > farthest[v, u] + margin:
                farthest[v, u], shown[v, u] = z, np.uint16(weight * ALWAYS + 0.5)
            else:
                goal = ALWAYS if z > farthest[v, u] - margin else 0
                shown[v, u] = np.uint16(last_share + weight * (goal - np.float64(last_share)) + 0.5)
                if goal == 0 and shown[v, u] < FORGOTTEN:  # almost never visible lately: replace it
                    farthest[v, u], shown[v, u] = z, ALWAYS
                elif shown[v, u] == last_share:
                    continue
            pixels[count] = v * depth.shape[1] + u
            count += 1
    return pixels[:count].copy()


@numba.njit(cache=True, nogil=True, error_model="numpy")
def permanence_of(depth: Depth, noise: DepthNoise, occupancy: Occupancy, window: Window) -> Depth:
    """The permanence (h, w) of what a window of a depth image (H, W) shows, from 0 to 1; 0 without depth."""
    left, top, right, bottom = window
    permanence = np.zeros((bottom - top, right - left), np.float32)
    for v in range(top, bottom):
        for u in range(left, right):
            z = depth[v, u]
            if z > 0.0:
                share = occupancy.shown[v, u] / ALWAYS
                margin = margin_at(z, noise)
                if z > occupancy.farthest[v, u] + margin:
                    share = 0.0  # it was never visible before
                elif z <= occupancy.farthest[v, u] - margin:
                    share = 1.0 - share
                permanence[v - top, u - left] = share
    return permanence
