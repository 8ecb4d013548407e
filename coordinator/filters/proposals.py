"""Noise that suits a body (preset `default`): most limbs are where they are expected, one may be anywhere.

Twenty particles cannot fill 24 dimensions. But limbs move, and are lost, one by one. So particles take
turns: some follow the motion model exactly, some stay where they were, the rest move one limb far and
leave the others to the descent.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.settings import FilterSettings

Array = NDArray[np.float64]

FAR = 0.02  # metres that a joint which slides is thrown, one standard deviation


def explore(
    model: BodyModel,
    noise: Array,
    velocities: Array,
    ancestors: NDArray[np.int64],
    settings: FilterSettings,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Noise and velocities (N, D). Children take turns: predicted, resting, one limb far, spread."""
    limbs, far = limbs_of(model), far_of(model, settings.limb_deviation_deg)
    standard = rng.standard_normal(noise.shape)
    limb = rng.integers(len(limbs), size=len(noise))
    noise, velocities = noise.copy(), velocities.copy()
    take_turns(turns(ancestors), limbs, limb, far * standard, noise, velocities)
    return noise, velocities


@numba.njit(cache=True, nogil=True)
def take_turns(
    turn: NDArray[np.int64],
    limbs: NDArray[np.bool_],
    limb: NDArray[np.int64],
    thrown: Array,
    noise: Array,
    velocities: Array,
) -> None:
    """Change noise and velocities (N, D) as `explore` gives them; limb (N,) and thrown (N, D) may come in."""
    for n in range(len(turn)):
        if turn[n] == 1:
            velocities[n] = 0.0
        if not spreads(turn[n]):
            for j in range(noise.shape[1]):
                noise[n, j] = thrown[n, j] if turn[n] > 1 and limbs[limb[n], j] else 0.0


@numba.njit(cache=True, nogil=True)
def turns(ancestors: NDArray[np.int64]) -> NDArray[np.int64]:
    """Which of its ancestor's children each particle is, from 0 on; ancestors (N,) ascend."""
    turn = np.zeros(len(ancestors), dtype=np.int64)
    for n in range(1, len(ancestors)):
        if ancestors[n] == ancestors[n - 1]:
            turn[n] = turn[n - 1] + 1
    return turn


@numba.njit(cache=True, nogil=True)
def spreads(turn: Any) -> Any:
    """Whether a child, or which of many, keeps the noise of its ancestor's covariance in full."""
    return (turn > 0) & (turn % 4 == 0)


@lru_cache(maxsize=16)
def far_of(model: BodyModel, limb_deviation_deg: float) -> Array:
    """How far (D,) a limb is thrown, one standard deviation, radians and metres."""
    return np.where(model.kinds == ROTATION, np.deg2rad(limb_deviation_deg), FAR)


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
