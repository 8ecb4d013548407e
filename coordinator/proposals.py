"""Noise that suits a body (preset `default`): most limbs are where they are expected, one may be anywhere.

Twenty particles cannot fill 24 dimensions. But limbs move, and are lost, one by one. So particles take
turns: some follow the motion model exactly, some stay where they were, the rest move one limb far and
leave the others to the descent.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.settings import FilterSettings

Array = NDArray[np.float64]


def explore(
    model: BodyModel,
    noise: Array,
    velocities: Array,
    ancestors: NDArray[np.int64],
    settings: FilterSettings,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Noise and velocities (N, D). Children take turns: predicted, resting, one limb far, spread."""
    limbs = limbs_of(model)
    far = np.where(model.kinds == ROTATION, np.deg2rad(settings.limb_deviation_deg), 0.02)
    standard = rng.standard_normal(noise.shape)
    limb = limbs[rng.integers(len(limbs), size=len(noise))]
    turn = turns(ancestors)[:, None]
    thrown = (turn > 1) & (turn % 4 != 0)
    noise = np.where(thrown & limb, far * standard, np.where(spread_out(ancestors)[:, None], noise, 0.0))
    return noise, np.where(turn == 1, 0.0, velocities)


def turns(ancestors: NDArray[np.int64]) -> NDArray[np.int64]:
    """Which of its ancestor's children each particle is, from 0 on; ancestors (N,) ascend."""
    return np.arange(len(ancestors)) - np.searchsorted(ancestors, ancestors)


def spread_out(ancestors: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which particles (N,) keep the noise of their ancestor's covariance in full."""
    turn = turns(ancestors)
    spread: NDArray[np.bool_] = (turn > 0) & (turn % 4 == 0)
    return spread


@lru_cache(maxsize=16)
def limbs_of(model: BodyModel) -> NDArray[np.bool_]:
    """Which degrees of freedom belong to each limb, (K, D)."""
    return np.array([np.isin(np.arange(len(model.kinds)), limb) for limb in find_limbs(model)])


def find_limbs(model: BodyModel) -> list[NDArray[np.int64]]:
    """Degrees of freedom in groups that move on their own: each branch of the tree, and the trunk."""
    children = np.bincount(model.parents[model.parents >= 0], minlength=len(model.parents))
    limb_of = np.empty(len(model.parents), dtype=np.int64)
    for j, parent in enumerate(model.parents):
        branches = parent < 0 or children[parent] > 1
        limb_of[j] = j if branches else limb_of[parent]
    return [np.flatnonzero(limb_of == start) for start in np.unique(limb_of)]
