"""Signed distance to smooth solids made of elliptic sections, and smooth unions of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

Array = NDArray[np.float64]

SAMPLES = 96


@dataclass(frozen=True)
class Loft:
    """Sections across one coordinate axis, with rounded ends.

    Rows of `sections` (S, 5): position along `axis`, centre and half-widths in the two other coordinates
    (in ascending order of coordinate). `caps` are the lengths of the half-ellipsoids beyond both ends.
    """

    axis: int
    sections: Array  # (S, 5)
    caps: tuple[float, float]

    def distance(self, points: Array) -> Array:
        """Approximate signed distance (n,) of points (n, 3): exact sign, first order near the surface."""
        table = self.resampled()
        along = points[:, self.axis]
        inside = np.clip(along, table[0, 0], table[-1, 0])
        step = (inside - table[0, 0]) / (table[1, 0] - table[0, 0])
        low = np.minimum(step.astype(np.int64), SAMPLES - 2)
        share = (step - low)[:, None]
        row = table[low, 1:] * (1.0 - share) + table[low + 1, 1:] * share
        beyond = along - inside
        cap = np.where(beyond < 0, *self.caps)
        across = np.delete(points, self.axis, axis=1) - row[:, :2]
        scaled = np.column_stack([across / row[:, 2:], beyond / cap])
        norm = np.sqrt(np.sum(scaled**2, axis=1))
        slope = np.sqrt(np.sum((scaled / np.column_stack([row[:, 2:], cap])) ** 2, axis=1))
        widest = np.max(row[:, 2:], axis=1)
        gradient = np.maximum(slope / np.maximum(norm, 1e-9), 1.0 / widest)
        return (norm - 1.0) / gradient

    def resampled(self) -> Array:
        """Sections (SAMPLES, 5) at equal distances on a monotone cubic through the given ones."""
        position = np.linspace(self.sections[0, 0], self.sections[-1, 0], SAMPLES)
        return np.column_stack(
            [position, PchipInterpolator(self.sections[:, 0], self.sections[:, 1:])(position)]
        )


def smooth_union(first: Array, second: Array, width: float) -> Array:
    """Smooth minimum of two distances: equal to the smaller where they differ by more than `width`."""
    overlap = np.maximum(width - np.abs(first - second), 0.0) / width
    return np.minimum(first, second) - overlap**3 * width / 6.0
