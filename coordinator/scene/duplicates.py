"""Duplicate bodies: everything visible of them is explained by other bodies.

Two bodies may come to fit the same person, for example after one person has hidden another. Each explains the
points of that person, so the points contradict neither of them. But a duplicate adds nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Mask
from gepf.coordinator.scene.scene import FOREGROUND, Depth, SceneView
from gepf.coordinator.settings import SegmentationSettings


class Evidence(NamedTuple):
    """What the image of a camera shows of N bodies.

    near: (N, H, W) the foreground near each body. distances: (N, H, W) of the pixels' points from each body,
    metres; infinite for a body that is not expected in the image. limits: those of the segmentation.
    """

    near: Mask
    distances: NDArray[np.float32]
    limits: SegmentationSettings


def evidence_of(view: SceneView, distances: Sequence[Depth | None]) -> Evidence:
    """The evidence for bodies, from the distances (H, W) of the pixels' points from each body.

    They are None for a body that may be anywhere, or for which the camera is not used.
    """
    limits, foreground = view.settings.segmentation, view.marks == FOREGROUND
    nowhere = np.full(foreground.shape, np.inf, dtype=np.float32)
    away = np.stack([nowhere if own is None else own for own in distances])
    return Evidence(foreground & (away <= limits.near_m), away, limits)


def find_duplicates(
    views: Sequence[Evidence], followed_s: Sequence[float], min_own_share: float
) -> list[bool]:
    """Which bodies are duplicates: others explain all but a share `min_own_share` of the pixels near them.

    Another body explains a pixel if it is near the pixel, and not farther from it than the first body by more
    than the resolution of the distances. Duplicates are removed one after another, because two bodies may
    explain each other: first the one with the smallest `followed_s`.
    """
    remaining = list(range(len(followed_s)))
    while True:
        explained = [n for n in remaining if is_explained(n, remaining, views, min_own_share)]
        if not explained:
            return [n not in remaining for n in range(len(followed_s))]
        remaining.remove(min(explained, key=lambda n: (followed_s[n], -n)))


def is_explained(body: int, bodies: Sequence[int], views: Sequence[Evidence], min_own_share: float) -> bool:
    """Whether the other bodies explain all but a share of the pixels near a body, in all views together."""
    others, near, own = [n for n in bodies if n != body], 0, 0
    for view in views:
        inside = view.near[body]
        if others and inside.any():
            mine, nearest = view.distances[body][inside], view.distances[others][:, inside].min(axis=0)
            theirs = (nearest <= view.limits.near_m) & (nearest <= mine + view.limits.cell_m)
            near, own = near + len(mine), own + int(np.count_nonzero(~theirs))
    return own < min_own_share * near
