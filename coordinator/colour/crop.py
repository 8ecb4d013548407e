"""The part of a colour image that the network sees: a square around a person, turned so that it is upright.

Pixels are those of the depth image, with integers at their centres. Places in the crop are counted from its
upper left edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics, project
from gepf.common.nearest_pixels import nearest_occupied_pixels

SIDE_PX = 256  # of what the network sees

Colours = NDArray[np.uint8]
"""Pixels (H, W, 3), RGB."""


class CropSettings(msgspec.Struct, frozen=True):
    """How a crop is placed, and which crops show much the same."""

    margin: float = 1.25  #: side of the crop / diameter of the person, with which the network was trained
    min_side_px: float = 8.0  #: in the image
    min_depth_m: float = 0.2  #: of a vertex that is projected
    max_black: int = 16  #: brightest channel of a pixel without colour, after compression
    same_shift_share: float = 0.15  #: between the middles of crops that show the same, of the side
    same_growth: float = np.log(1.5)  #: logarithm of the ratio of their sides
    same_turn: float = np.radians(30.0)  #: angle between them


CROPS = CropSettings()


@dataclass(frozen=True, slots=True)
class Crop:
    """A square around (`column`, `row`) with sides of `side` pixels, turned clockwise by `turn` radians."""

    column: float
    row: float
    side: float
    turn: float = 0.0

    @classmethod
    def around(cls, middle: Array, radius: float, upward: Array) -> Self:
        """The square for a person within a `radius` of the middle (2,), pixels.

        `upward` (2,) is the direction in the image from the middle to the head.
        """
        turn = float(np.arctan2(upward[0], -upward[1])) if upward.any() else 0.0
        side = max(CROPS.min_side_px, 2.0 * CROPS.margin * radius)
        return cls(float(middle[0]), float(middle[1]), side, turn)

    def to_image(self, places: Array) -> Array:
        """Pixels (..., 2) of the image at places (..., 2) in the crop."""
        off = (places - 0.5 * SIDE_PX) * (self.side / SIDE_PX)
        return np.asarray(off @ self._turned.T + (self.column, self.row))

    def take(self, colours: Colours, measured: Mask, max_gap_px: float) -> Colours:
        """The pixels (SIDE_PX, SIDE_PX, 3) of an image (h, w, 3), black outside of it.

        The image shows what the depth image shows, at any scale; `measured` (H, W) marks pixels with depth.
        Registered colour has gaps where there is no depth; those up to `max_gap_px` wide are closed.
        """
        corners = self.to_image(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])) + 0.5
        scale = np.array(colours.shape[1::-1]) / measured.shape[::-1]
        shrink = max(1, int(self.side * scale.max() / SIDE_PX))
        image = Image.fromarray(colours)
        seen = warp(image.reduce(shrink), corners * scale / shrink, Image.Resampling.BILINEAR)
        holds = warp(Image.fromarray(measured), corners, Image.Resampling.NEAREST)
        return close_gaps(seen, holds > 0, max_gap_px * SIDE_PX / self.side)

    def fits(self, other: Crop) -> bool:
        """Whether both show much the same: their middles are near, and their sides and turns similar."""
        apart = max(abs(self.column - other.column), abs(self.row - other.row))
        turned = abs((self.turn - other.turn + np.pi) % (2.0 * np.pi) - np.pi)
        ratio = abs(np.log(self.side / other.side))
        near = apart < CROPS.same_shift_share * other.side
        return bool(near and ratio < CROPS.same_growth and turned < CROPS.same_turn)

    def overlaps(self, shape: tuple[int, ...]) -> bool:
        """Whether the middle of the crop is near an image (H, W), at most half of its side away."""
        away = max(-self.column, self.column - shape[1], -self.row, self.row - shape[0])
        return away < 0.5 * self.side

    @property
    def _turned(self) -> Array:
        """The rotation (2, 2) from the crop to the image."""
        c, s = np.cos(self.turn), np.sin(self.turn)
        return np.array([[c, -s], [s, c]])


def crop_of_points(points: Array, upward: Array, camera: Intrinsics, reach_m: float) -> Crop:
    """The crop around a person of whom points (P, 3) are seen; `upward` (3,), camera's frame.

    The person may reach `reach_m` from the middle of the points.

    The points may be a part of the person, and a little more: the network looks again where it sees one.
    """
    middle = np.median(points, axis=0)
    before, above = project(np.stack([middle, middle + 0.1 * upward]), camera)
    return Crop.around(before, reach_m * 0.5 * (camera.fx + camera.fy) / float(middle[2]), above - before)


def warp(image: Image.Image, corners: Array, how: Image.Resampling) -> NDArray[np.uint8]:
    """Resample an image to that of a crop.

    `corners` (3, 2): the places in the image of the upper left edge of the result, and one pixel to the right
    and down from there.
    """
    right, down = corners[1] - corners[0], corners[2] - corners[0]
    rows = (right[0], down[0], corners[0, 0], right[1], down[1], corners[0, 1])
    if image.mode == "1":
        image = image.convert("L")
    return np.array(image.transform((SIDE_PX, SIDE_PX), Image.Transform.AFFINE, rows, how))


def close_gaps(colours: Colours, measured: Mask, widest: float) -> Colours:
    """Colours (H, W, 3), with narrow black gaps that were not `measured` (H, W) filled by the nearest."""
    brightest = np.maximum(np.maximum(colours[..., 0], colours[..., 1]), colours[..., 2])
    gap = ~measured & (brightest <= CROPS.max_black)
    if not gap.any() or gap.all():
        return colours
    rows, columns = np.nonzero(gap)
    nearest_rows, nearest_columns = nearest_occupied_pixels(~gap)[:, rows, columns]
    close = np.hypot(nearest_rows - rows, nearest_columns - columns) <= 0.5 * widest
    closed = colours.copy()
    closed[rows[close], columns[close]] = colours[nearest_rows[close], nearest_columns[close]]
    return closed


def crop_of_body(vertices: Array, hips: Array, shoulders: Array, camera: Intrinsics) -> Crop | None:
    """The crop around a body with vertices (V, 3), middles of hips (3,) and shoulders (3,), camera's frame.

    None if it is not in front of the camera.
    """
    ahead = vertices[:, 2] > CROPS.min_depth_m
    if not ahead.any() or min(hips[2], shoulders[2]) <= CROPS.min_depth_m:
        return None
    middle, above = project(np.stack([hips, shoulders]), camera)
    radius = np.linalg.norm(project(vertices[ahead], camera) - middle, axis=1).max()
    return Crop.around(middle, float(radius), above - middle)
