"""Particles that came down into the same valley become one hypothesis (step 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.kinematics import difference

Array = NDArray[np.float64]


def merge(
    model: BodyModel, poses: Array, log_likelihood: Array, angle: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Group refined particles that differ by less than `angle` in every rotation.

    Particles are taken from the likeliest down; each joins the first representative that is near enough,
    or becomes one. So the representative is the likeliest of its group, as the paper asks.

    Args:
        model: The body.
        poses: Refined particles (N, D).
        log_likelihood: Of each (N,).
        angle: The distance d, radians. Positions are not compared.

    Returns:
        The representatives (M,) as indices of particles, likeliest first, and for each particle the
        place (N,) of its representative among them.
    """
    angles = np.flatnonzero(model.kinds == ROTATION)
    representatives: list[int] = []
    group = np.empty(len(poses), dtype=np.int64)
    for n in np.argsort(-log_likelihood, kind="stable"):
        group[n] = _first_within(model, poses, representatives, int(n), angles, angle)
        if group[n] == len(representatives):
            representatives.append(int(n))
    return np.array(representatives, dtype=np.int64), group


def _first_within(
    model: BodyModel,
    poses: Array,
    representatives: list[int],
    n: int,
    angles: NDArray[np.int64],
    angle: float,
) -> int:
    """Place of the first representative near particle n; their number where there is none."""
    if not representatives:
        return 0
    origins = np.broadcast_to(poses[n], (len(representatives), poses.shape[1]))
    apart = np.abs(difference(model, origins, poses[representatives])[:, angles]).max(axis=1, initial=0.0)
    near = np.flatnonzero(apart < angle)
    return int(near[0]) if len(near) else len(representatives)
