"""Signed distance to smooth solids made of elliptic sections, and smooth unions of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]

SAMPLES = 96
REACH, FAR = 0.12, 1.0
"""Farther than REACH metres from a loft's box its distance is not worth computing, and counts as FAR."""


@dataclass(frozen=True)
class Loft:
    """Sections across one coordinate axis, with rounded ends.

    Rows of `sections` (S, 5): position along `axis` in ascending order, then centre and half-widths in the
    two other coordinates. `caps` are the lengths of the half-ellipsoids beyond the first and last section.
    """

    axis: int
    sections: Array  # (S, 5)
    caps: tuple[float, float]

    def distance(self, points: Array) -> Array:
        """Approximate signed distance (n,) of points (n, 3): right in sign, first order near the surface."""
        low, high = self._box
        near = np.all((points > low) & (points < high), axis=1)
        distance = np.full(len(points), FAR)
        distance[near] = self._near_distance(points[near])
        return distance

    def _near_distance(self, points: Array) -> Array:
        """From the implicit function f = 1 - |scaled point|, as f / |gradient of f|."""
        table = self._table
        along = np.clip(points[:, self.axis], table[0, 0], table[-1, 0])
        step = (along - table[0, 0]) / (table[1, 0] - table[0, 0])
        row = np.minimum(step.astype(np.int64), SAMPLES - 2)
        share = (step - row)[:, None]
        centre_width = table[row, 1:] * (1.0 - share) + table[row + 1, 1:] * share
        beyond = points[:, self.axis] - along
        a, b, c = centre_width[:, 2], centre_width[:, 3], np.where(beyond < 0.0, *self.caps)
        first, second = (k for k in range(3) if k != self.axis)
        u = (points[:, first] - centre_width[:, 0]) / a
        v = (points[:, second] - centre_width[:, 1]) / b
        w = beyond / c
        norm = np.sqrt(u * u + v * v + w * w)
        slope = np.sqrt((u / a) ** 2 + (v / b) ** 2 + (w / c) ** 2) / np.maximum(norm, 1e-9)
        return np.asarray((norm - 1.0) / np.maximum(slope, 1.0 / np.maximum(a, b)))

    @cached_property
    def _table(self) -> Array:
        """Sections (SAMPLES, 5) at equal distances on a monotone cubic through the given ones."""
        position = np.linspace(self.sections[0, 0], self.sections[-1, 0], SAMPLES)
        between = PchipInterpolator(self.sections[:, 0], self.sections[:, 1:])
        return np.column_stack([position, between(position)])

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        low, high = np.empty(3), np.empty(3)
        others = [k for k in range(3) if k != self.axis]
        low[self.axis] = self.sections[0, 0] - self.caps[0]
        high[self.axis] = self.sections[-1, 0] + self.caps[1]
        low[others] = np.min(self.sections[:, 1:3] - self.sections[:, 3:], axis=0)
        high[others] = np.max(self.sections[:, 1:3] + self.sections[:, 3:], axis=0)
        return low - REACH, high + REACH


def smooth_union(distances: Iterable[Array], width: float) -> Array:
    """Smooth minimum of distances: each pair's smaller one where the two differ by more than `width`."""

    def of_two(first: Array, second: Array) -> Array:
        overlap = np.maximum(width - np.abs(first - second), 0.0) / width
        return np.minimum(first, second) - overlap**3 * width / 6.0

    return reduce(of_two, distances)
