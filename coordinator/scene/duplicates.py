"""Duplicate bodies: everything that is seen of one of them is explained by others.

Two bodies may come to fit the same person, for example after one person has hidden another. Each explains the
points of that person, so the points contradict neither of them. But a duplicate adds nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Mask
from gepf.coordinator.scene.scene import FOREGROUND, Depth, SceneView


class Evidence(NamedTuple):
    """What the image of a camera shows of N bodies.

    near: (N, H, W) the foreground near each body. explained: (N, H, W) the part of it so near that the body
    explains it, also if it is not there alone.
    """

    near: Mask
    explained: Mask


def evidence_of(view: SceneView, distances: Sequence[Depth | None]) -> Evidence:
    """The evidence for bodies, from the distances (H, W) of the pixels' points from each body.

    They are None for a body that may be anywhere, or for which the camera is not used.
    """
    limits, foreground = view.settings.segmentation, view.marks == FOREGROUND
    near = np.zeros((len(distances), *foreground.shape), dtype=np.bool_)
    explained = np.zeros_like(near)
    for n, away in enumerate(distances):
        if away is not None:
            near[n] = foreground & (away <= limits.near_m)
            explained[n] = foreground & (away <= limits.explained_m)
    return Evidence(near, explained)


def find_duplicates(
    views: Sequence[Evidence], followed_s: Sequence[float], min_own_share: float
) -> list[bool]:
    """Which bodies are duplicates: others explain all but a share `min_own_share` of the pixels near them.

    They are removed one after another, because each may explain the other: first the one that has been
    `followed_s` for the shortest time.
    """
    left = list(range(len(followed_s)))
    while True:
        near, own = np.zeros(len(followed_s)), np.zeros(len(followed_s))
        for view in views:
            count = view.explained[left].sum(axis=0, dtype=np.uint8)
            for n in left:
                near[n] += np.count_nonzero(view.near[n])
                own[n] += np.count_nonzero(view.near[n] & (count == view.explained[n]))
        explained = [n for n in left if own[n] < min_own_share * near[n]]
        if not explained:
            return [n not in left for n in range(len(followed_s))]
        left.remove(min(explained, key=lambda n: (followed_s[n], -n)))
