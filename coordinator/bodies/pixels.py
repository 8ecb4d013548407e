"""How likely a pixel shows a body rather than a thing, from the shape of the surface around it.

Furniture touches the people who use it, so steps in depth do not separate them. A random forest does: it
compares the depths at pairs of places around a pixel, whose distances from it are in metres (J. Shotton et
al., Real-time human pose recognition in parts from single depth images, CVPR 2011).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.camera import Intrinsics
from gepf.common.compiling import numba

Depth = NDArray[np.float32]
Nodes = tuple[Indices, Array, Array]
"""Features (N,), -1 at leaves, thresholds (N,) and shares of bodies (N,) of a tree's nodes, breadth first."""

SHARE_UNITS = 255  # shares are stored as multiples of 1 / 255
MAX_PIXELS = 1_500  # of a mask that are looked at; the others follow those around them
SMOOTHED_M = 0.06  # side of the square over which shares are averaged
MIN_DOWN = 0.1  # less of the direction down is in the image of a camera that looks straight down
LIKELY = 0.5  # mean share around a pixel of a body


class Trees(NamedTuple):
    """Trees with N nodes in all.

    roots: (T,) nodes. features: (N,), -1 at a leaf. thresholds: (N,) metres, up to which the left child
    follows. left: (N,) the left child; the right one is the next node. shares: (N,) of the pixels at a leaf
    that show a body.
    """

    roots: NDArray[np.int32]
    features: NDArray[np.int16]
    thresholds: NDArray[np.float32]
    left: NDArray[np.int32]
    shares: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class PixelForest:
    """A forest and its features.

    offsets: (F, 2, 2) the pair of places of each feature, to the right and down from the pixel, metres.
    limit_m: differences of depth are clipped to it, and a missing depth counts as that far behind.
    """

    offsets: NDArray[np.float32]
    limit_m: float
    trees: Trees

    @classmethod
    def of(cls, offsets: NDArray[np.float32], limit_m: float, nodes: Sequence[Nodes]) -> PixelForest:
        """The forest of trees with these nodes; shares are rounded as in its file."""
        sizes = [len(features) for features, _, _ in nodes]
        features, thresholds, shares = (np.concatenate(column) for column in zip(*nodes, strict=True))
        roots = np.cumsum([0, *sizes[:-1]])
        inner_before = [np.cumsum(of_tree >= 0) - (of_tree >= 0) for of_tree, _, _ in nodes]
        left = np.repeat(roots, sizes) + 1 + 2 * np.concatenate(inner_before)
        trees = Trees(
            roots.astype(np.int32),
            features.astype(np.int16),
            thresholds.astype(np.float32),
            left.astype(np.int32),
            np.rint(SHARE_UNITS * shares).astype(np.float32) / SHARE_UNITS,
        )
        return cls(offsets.astype(np.float32), limit_m, trees)

    @classmethod
    def load(cls, path: Path) -> PixelForest:
        """Read the file of a forest."""
        with np.load(path) as file:
            columns = file["features"], file["thresholds"], file["shares"] / SHARE_UNITS
            ends = np.cumsum(file["sizes"])[:-1]
            nodes = list(zip(*(np.split(column, ends) for column in columns), strict=True))
            return cls.of(file["offsets"], float(file["limit_m"]), nodes)

    def save(self, path: Path) -> None:
        """Write the file of the forest."""
        trees, shares = self.trees, np.rint(SHARE_UNITS * self.trees.shares)
        np.savez_compressed(
            path,
            offsets=self.offsets,
            limit_m=self.limit_m,
            sizes=np.diff([*trees.roots, len(trees.features)]),
            features=trees.features,
            thresholds=trees.thresholds,
            shares=np.where(trees.features < 0, shares, 0).astype(np.uint8),
        )

    def find_body(self, depth: Depth, camera: Intrinsics, mask: Mask, down: Array) -> Mask:
        """Those pixels of a mask (H, W) with depth around which most of the surface is that of a body.

        depth: (H, W) metres, 0 where missing. down: (2,) the direction in the image, columns and rows, that
        points down in the room.
        """
        measured = mask & (depth > 0.0)
        pixels = np.flatnonzero(measured)
        if not len(pixels):
            return measured
        looked_at = pixels[:: -(-len(pixels) // MAX_PIXELS)]
        shares, weights = np.zeros(depth.size, np.float32), np.zeros(depth.size, np.float32)
        shares[looked_at], weights[looked_at] = self.shares_at(depth, camera, looked_at, down), 1.0
        size = max(1, round(float(SMOOTHED_M * camera.fx / np.median(depth.ravel()[looked_at]))))
        smooth, weight = (uniform_filter(image.reshape(depth.shape), size) for image in (shares, weights))
        return np.asarray(measured & (smooth > LIKELY * weight))

    def shares_at(self, depth: Depth, camera: Intrinsics, pixels: Indices, down: Array) -> Depth:
        """How likely pixels with depth and flat indices (P,) show a body: the mean shares (P,)."""
        right, below = (down[1], down[0]) if np.hypot(*down) > MIN_DOWN else (1.0, 0.0)
        turn = np.array([[right, below], [-below, right]]) / np.hypot(right, below)
        offsets = (self.offsets @ turn.T).astype(np.float32) * np.float32(camera.fx)
        return classify(depth, pixels, offsets, self.limit_m, self.trees)

    def shares_by(self, values: NDArray[np.float32]) -> Depth:
        """The mean shares (P,) for features (P, F)."""
        trees, pixels = self.trees, np.arange(len(values))[:, None]
        nodes = np.tile(trees.roots, (len(values), 1))
        while (inner := trees.features[nodes] >= 0).any():
            right = values[pixels, trees.features[nodes]] > trees.thresholds[nodes]
            nodes = np.where(inner, trees.left[nodes] + right, nodes)
        return np.asarray(trees.shares[nodes].mean(axis=1))


@numba.njit(cache=True, nogil=True)
def describe(depth: Depth, pixels: Indices, offsets: NDArray[np.float32], limit: float) -> Depth:
    """Features (P, F) of pixels with flat indices (P,), metres; offsets in pixels times metres."""
    values = np.empty((len(pixels), len(offsets)), dtype=np.float32)
    for n in range(len(pixels)):
        for feature in range(len(offsets)):
            values[n, feature] = difference(depth, pixels[n], offsets[feature], limit)
    return values


@numba.njit(cache=True, nogil=True)
def classify(
    depth: Depth, pixels: Indices, offsets: NDArray[np.float32], limit: float, trees: Trees
) -> Depth:
    """The mean shares (P,) of the leaves that pixels with flat indices (P,) reach."""
    shares = np.empty(len(pixels), dtype=np.float32)
    for n in range(len(pixels)):
        total = 0.0
        for root in trees.roots:
            node = root
            while trees.features[node] >= 0:
                value = difference(depth, pixels[n], offsets[trees.features[node]], limit)
                node = trees.left[node] + (1 if value > trees.thresholds[node] else 0)
            total += trees.shares[node]
        shares[n] = total / len(trees.roots)
    return shares


@numba.njit(cache=True, nogil=True, inline="always")
def difference(depth: Depth, pixel: int, pair: NDArray[np.float32], limit: float) -> np.float32:
    """How much deeper the first place of a pair is than the second one."""
    return behind(depth, pixel, pair[0], limit) - behind(depth, pixel, pair[1], limit)


@numba.njit(cache=True, nogil=True, inline="always")
def behind(depth: Depth, pixel: int, offset: NDArray[np.float32], limit: float) -> np.float32:
    """How much deeper a place is than the pixel, clipped; the limit where depth is missing."""
    rows, columns = depth.shape
    row, column = pixel // columns, pixel % columns
    z = depth[row, column]
    r, c = row + int(np.rint(offset[1] / z)), column + int(np.rint(offset[0] / z))
    if not (0 <= r < rows and 0 <= c < columns) or not depth[r, c] > 0.0:
        return np.float32(limit)
    return min(np.float32(limit), max(np.float32(-limit), depth[r, c] - z))
