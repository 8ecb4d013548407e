"""The size and shape of a valley, from the particles that fell into it (step 7, Eq. 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import difference

Array = NDArray[np.float64]


def estimate_covariances(
    model: BodyModel,
    before: Array,
    merged: Array,
    group: NDArray[np.int64],
    inherited: Array,
    reduction: float,
) -> Array:
    """Covariances (M, D, D) of relative motion about each merged hypothesis, Eq. 7.

    Taken from the particles *before* their descent, about the hypothesis after it, so that the next ones
    are drawn out to the valley's rim. A lone particle tells nothing of its valley's size (Eq. 7 would
    leave a single direction): it keeps what it inherited. Both are then reduced.

    Args:
        model: The body.
        before: Particles (N, D) before their descent.
        merged: Hypotheses (M, D) after it.
        group: For each particle (N,) the hypothesis it merged into.
        inherited: Covariance (M, D, D) of the hypothesis that each representative was drawn from.
        reduction: Share by which every covariance shrinks each frame.
    """
    covariances = np.array(inherited)
    spread = difference(model, merged[group], before)
    for m in np.flatnonzero(np.bincount(group, minlength=len(merged)) > 1):
        members = spread[group == m]
        covariances[m] = members.T @ members / len(members)
    return covariances * (1.0 - reduction)
