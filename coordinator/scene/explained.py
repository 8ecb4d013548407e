"""Bodies without evidence of their own: another body explains what they show.

Two bodies may come to fit the same person, after a detection or after people have hidden each other. Each
explains the points of that person, so neither is contradicted by them. But a body that another one explains
away adds nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from gepf.common.arrays import Array
from gepf.coordinator.scene.scene import FOREGROUND, Depth, SceneView
from gepf.coordinator.scene.segmentation import slices, window_of


def count_explained(
    view: SceneView, surfaces: Sequence[Array | None], distances: Sequence[Depth | None]
) -> Array:
    """Numbers (N, N) of foreground pixels near body n that body m explains; the diagonal holds all of them.

    surfaces: vertices (V, 3) of each body, camera frame, metres. distances: those (H, W) of the pixels'
    points from each body. Both are None for a body that may be anywhere.
    """
    counts = np.zeros((len(surfaces), len(surfaces)))
    limits = view.settings.segmentation
    for n, m in permutations(range(len(surfaces)), 2):
        first, second, own, other = surfaces[n], surfaces[m], distances[n], distances[m]
        if first is None or second is None or own is None or other is None or not overlap(first, second):
            continue
        inside = slices(window_of(view, first))
        near = (own[inside] <= limits.near_m) & (view.marks[inside] == FOREGROUND)
        counts[n, n] = np.count_nonzero(near)
        counts[n, m] = np.count_nonzero(near & (other[inside] <= limits.explained_m))
    return counts


def overlap(first: Array, second: Array) -> bool:
    """Whether the bounding boxes of two surfaces (V, 3) overlap."""
    low = np.maximum(first.min(axis=0), second.min(axis=0))
    return bool(np.all(low < np.minimum(first.max(axis=0), second.max(axis=0))))


def explained_away(counts: Array, known_s: Sequence[float], min_own_share: float) -> list[bool]:
    """Which bodies have no evidence of their own, from the counts (N, N) of `count_explained`.

    Of two that explain each other, it is the one that has been known for less time, `known_s`.
    """
    away = [False] * len(counts)
    own = np.diag(counts)
    shares = 1.0 - counts / np.maximum(own[:, None], 1.0)
    np.fill_diagonal(shares, 1.0)
    while True:
        left = [n for n in range(len(away)) if not away[n]]
        explained = [n for n in left if min(shares[n, left]) < min_own_share]
        if not explained:
            return away
        away[min(explained, key=lambda n: (known_s[n], -n))] = True
