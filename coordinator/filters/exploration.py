"""Proposals that explore a body limb by limb (preset `default`).

Twenty particles cannot fill 24 dimensions. But limbs move, and are lost, one by one. So fixed shares of the
particles, whatever the number of hypotheses, are of five kinds: some follow the motion model exactly, some
stay where their hypothesis was, some move one limb far (or hold a hidden one in another way that hides it),
some hold a limb so that it reaches for what nothing explains, and the others are spread by the covariance
of their hypothesis.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel

Array = NDArray[np.float64]
Kinds = NDArray[np.int64]

PREDICTED, RESTING, ONE_LIMB, REACHING, SPREAD, HIDING = range(6)  # kinds of proposals
SHARES = np.array([0.15, 0.1, 0.1, 0.25, 0.4])  # of the particles; one limb hides in place of being thrown
SUMS = np.cumsum(SHARES)
GOLDEN = 0.6180339887498949  # any run of its multiples is spread evenly over the unit interval

LIMB_DEVIATION = np.radians(30.0)  # by which a limb is thrown, in each of its joints, one standard deviation
SLIDE_DEVIATION = 0.02  # metres by which a joint that slides is perturbed, one standard deviation


def choose_kinds(count: int, rng: np.random.Generator) -> Kinds:
    """The kind (N,) of each particle; the first, drawn from the reported hypothesis, is predicted."""
    places = (rng.random() + GOLDEN * np.arange(count)) % 1.0
    kinds = np.minimum(np.searchsorted(SUMS, places, side="right"), SPREAD)
    kinds[0] = PREDICTED
    return kinds


def perturb(model: BodyModel, kinds: Kinds, noise: Array, rng: np.random.Generator) -> Array:
    """Noise (N, D) of particles by their kind (N,), from that of their covariances (N, D)."""
    limbs = limbs_of(model)
    standard = rng.standard_normal(noise.shape)
    limb = rng.integers(len(limbs), size=len(noise))
    thrown = limbs[limb] & (kinds == ONE_LIMB)[:, None]
    perturbed: Array = np.where(
        (kinds == SPREAD)[:, None], noise, np.where(thrown, limb_deviation(model) * standard, 0.0)
    )
    return perturbed


@lru_cache(maxsize=16)
def limb_deviation(model: BodyModel) -> Array:
    """Standard deviation (D,) of what a limb is perturbed by, radians and metres."""
    return np.where(model.kinds == ROTATION, LIMB_DEVIATION, SLIDE_DEVIATION)


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
