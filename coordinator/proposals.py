"""Noise that suits a body (preset `default`): most limbs are where they are expected, one may be anywhere.

Twenty particles cannot fill 24 dimensions. But limbs move, and are lost, one by one. So particles take
turns: some follow the motion model exactly, some stay where they were, the rest move one limb far and
leave the others to the descent.
"""

from __future__ import annotations

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
    limbs = find_limbs(model)
    far = np.where(model.kinds == ROTATION, np.deg2rad(settings.limb_deviation_deg), 0.02)
    standard = rng.standard_normal(noise.shape)
    which = rng.integers(len(limbs), size=len(noise))
    noise, velocities = noise.copy(), velocities.copy()
    for n in range(len(noise)):
        turn = n - int(np.searchsorted(ancestors, ancestors[n]))
        if turn == 0:
            noise[n] = 0.0
        elif turn == 1:
            noise[n] = 0.0
            velocities[n] = 0.0
        elif turn % 4 != 0:
            limb = limbs[which[n]]
            noise[n] = 0.0
            noise[n, limb] = far[limb] * standard[n, limb]
    return noise, velocities


def find_limbs(model: BodyModel) -> list[NDArray[np.int64]]:
    """Degrees of freedom in groups that move on their own: each branch of the tree, and the trunk."""
    children = np.bincount(model.parents[model.parents >= 0], minlength=len(model.parents))
    limb_of = np.empty(len(model.parents), dtype=np.int64)
    for j, parent in enumerate(model.parents):
        branches = parent < 0 or children[parent] > 1
        limb_of[j] = j if branches else limb_of[parent]
    return [np.flatnonzero(limb_of == start) for start in np.unique(limb_of)]
