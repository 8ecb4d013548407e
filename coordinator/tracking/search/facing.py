"""Which way a body faces: front and back of a person who stands look nearly alike in depth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coordinator.tracking.search.stages import Standing

Array = NDArray[np.float64]

PAIRS = ("hip", "shoulder")
TOLD_APART = 2.0  # log likelihood by which who faces one way explains a frame better than who faces the other


def has_sides(names: tuple[str, ...]) -> bool:
    """Whether a body of these joints has a left and a right, as a person has."""
    return all(f"{side}_{pair}" in names for side in ("left", "right") for pair in PAIRS)


def across(names: tuple[str, ...], joints: Array) -> Array:
    """From right to left (..., 3) through a body whose joints (..., J, 3) have these names."""
    apart = [
        joints[..., names.index(f"left_{pair}"), :] - joints[..., names.index(f"right_{pair}"), :]
        for pair in PAIRS
    ]
    summed: Array = np.sum(apart, axis=0)
    return summed


def turned_round(names: tuple[str, ...], joints: Array, body: Array) -> NDArray[np.bool_]:
    """Which of the bodies with joints (M, J, 3) face away from where a body (J, 3) faces."""
    if not has_sides(names):
        return np.zeros(len(joints), dtype=np.bool_)
    return across(names, joints) @ across(names, body) < 0.0


def both_ways(standing: Standing, names: tuple[str, ...], count: int, apart: float) -> Standing:
    """The likeliest that differ, and the likeliest that faces the other way, if none of them does."""
    kept = standing.differing(count, apart)
    turned = turned_round(names, standing.joints, standing.joints[0])
    if not turned[kept].any():
        kept = np.sort(np.append(kept, np.flatnonzero(turned)[:1]))
    return standing.take(kept)


def looks_alike(names: tuple[str, ...], standing: Standing, body: Array, log_likelihood: float) -> bool:
    """Whether some that faces away from a body (J, 3) explains the frame about as well as that does."""
    turned = turned_round(names, standing.joints, body)
    rivals = standing.log_likelihood[turned]
    return bool(np.any(rivals > log_likelihood - TOLD_APART))
