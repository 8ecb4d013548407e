"""Proposals that explore a body limb by limb (preset `default`).

Twenty particles cannot fill 24 dimensions. But limbs move, and are lost, one by one. So the particles drawn
from one hypothesis are of four kinds: the first follows the motion model exactly, the second stays where the
hypothesis was, every fourth has the noise of its covariance, and the rest move one limb far and leave the
others to the descent.
"""

from __future__ import annotations

from functools import lru_cache

import numba
import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.settings import FilterSettings

Array = NDArray[np.float64]
Kinds = NDArray[np.int64]

PREDICTED, RESTING, ONE_LIMB, SPREAD = range(4)  # kinds of proposals
SPREAD_EVERY = 4  # particles of one ancestor
SLIDE_DEVIATION = 0.02  # metres by which a joint that slides is perturbed, one standard deviation


def explore(
    model: BodyModel,
    noise: Array,
    velocities: Array,
    ancestors: NDArray[np.int64],
    settings: FilterSettings,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Noise and velocities (N, D) of particles by their kind, from those that the motion model has."""
    limbs, deviation = limbs_of(model), limb_deviation(model, settings.limb_deviation_deg)
    standard = rng.standard_normal(noise.shape)
    limb = rng.integers(len(limbs), size=len(noise))
    noise, velocities = noise.copy(), velocities.copy()
    perturb(proposal_kinds(ancestors), limbs, limb, deviation * standard, noise, velocities)
    return noise, velocities


@numba.njit(cache=True, nogil=True)
def perturb(
    kinds: Kinds,
    limbs: NDArray[np.bool_],
    limb: NDArray[np.int64],
    perturbation: Array,
    noise: Array,
    velocities: Array,
) -> None:
    """Change noise and velocities (N, D) by the kind (N,) of each particle.

    A particle that moves one limb gets its perturbation (N, D) in that limb (N,) of `limbs` (K, D).
    """
    for n in range(len(kinds)):
        if kinds[n] == RESTING:
            velocities[n] = 0.0
        if kinds[n] != SPREAD:
            for j in range(noise.shape[1]):
                moves = kinds[n] == ONE_LIMB and limbs[limb[n], j]
                noise[n, j] = perturbation[n, j] if moves else 0.0


@numba.njit(cache=True, nogil=True)
def proposal_kinds(ancestors: NDArray[np.int64]) -> Kinds:
    """The kind (N,) of each particle by its place among those of its ancestor; ancestors (N,) ascend."""
    kinds = np.empty(len(ancestors), dtype=np.int64)
    place = 0
    for n in range(len(ancestors)):
        place = place + 1 if n > 0 and ancestors[n] == ancestors[n - 1] else 0
        if place < ONE_LIMB:
            kinds[n] = place
        else:
            kinds[n] = SPREAD if place % SPREAD_EVERY == 0 else ONE_LIMB
    return kinds


@lru_cache(maxsize=16)
def limb_deviation(model: BodyModel, limb_deviation_deg: float) -> Array:
    """Standard deviation (D,) of what a limb is perturbed by, radians and metres."""
    return np.where(model.kinds == ROTATION, np.deg2rad(limb_deviation_deg), SLIDE_DEVIATION)


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
