"""How permanent what a pixel shows is, for a camera that stands still.

The surface of the scene is the farthest that a pixel ever showed. Whatever has covered it for only a part of
the recent time has moved, and is no part of the scene. What covered it all the time may be: a person, or the
chair on which the person has been sitting from the first frame on. So a pixel's permanence is the share of
the time for which it showed nothing behind the present surface. Before its first depth, a pixel showed
something behind it. Occupancy grids (Moravec and Elfes, 1985) accumulate the same evidence in cells of space.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.compiling import numba
from gepf.coordinator.scene.noise import DepthNoise, margin_at

Depth = NDArray[np.float32]
Shares = NDArray[np.uint16]  # from 0 to ALWAYS

ALWAYS = 65_535


class Occupancy(NamedTuple):
    """What the pixels (H, W) showed until now.

    farthest: the farthest depth, metres; 0 if none was measured. shown: the share of the time for which it
    was visible.
    """

    farthest: Depth
    shown: Shares

    @classmethod
    def unknown(cls, shape: tuple[int, ...]) -> Occupancy:
        """Before the first image of this shape (H, W)."""
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
def accumulate(
    depth: Depth, noise: DepthNoise, occupancy: Occupancy, weight: float, permanence: Depth
) -> NDArray[np.uint32]:
    """Add a depth image (H, W) in place, and fill the permanence (H, W) of what it shows, 0 without depth.

    `weight` is the part of the time that the image stands for. Returns the flat indices (N,) of the changed
    pixels.
    """
    farthest, shown = occupancy.farthest, occupancy.shown
    pixels = np.empty(depth.size, dtype=np.uint32)
    count = 0
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z, last_farthest, last_share = depth[v, u], farthest[v, u], shown[v, u]
            permanence[v, u] = 0.0
            if not z > 0.0:
                continue
            margin = margin_at(z, noise)
            if z > last_farthest + margin:
                farthest[v, u], shown[v, u] = z, np.uint16(weight * ALWAYS + 0.5)
            else:
                is_shown = z > last_farthest - margin
                goal = ALWAYS if is_shown else 0
                shown[v, u] = np.uint16(last_share + weight * (goal - np.float64(last_share)) + 0.5)
            share = shown[v, u] / ALWAYS
            permanence[v, u] = share if z > farthest[v, u] - margin else 1.0 - share
            if farthest[v, u] != last_farthest or shown[v, u] != last_share:
                pixels[count] = v * depth.shape[1] + u
                count += 1
    return pixels[:count].copy()
