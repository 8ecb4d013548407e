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
    representatives: list[int] = []
    group = np.empty(len(poses), dtype=np.int64)
    for n in np.argsort(-log_likelihood, kind="stable"):
        near = _near(model, poses[n], poses[representatives], angle)
        group[n] = near[0] if len(near) else len(representatives)
        if not len(near):
            representatives.append(int(n))
    return np.array(representatives, dtype=np.int64), group


def _near(model: BodyModel, pose: Array, others: Array, angle: float) -> NDArray[np.int64]:
    """Which other poses (M, D) differ by less than `angle` in every rotation, in order.

    Single axes tell most apart already, by a subtraction; balls need matrices.
    """
    rotations = model.kinds == ROTATION
    hinges = rotations.copy()
    hinges[(model.balls[:, None] + np.arange(3)).ravel()] = False
    likely = np.flatnonzero(np.all(np.abs(others - pose)[:, hinges] < angle, axis=1))
    steps = difference(model, np.broadcast_to(pose, (len(likely), len(pose))), others[likely])
    return likely[np.all(np.abs(steps[:, rotations]) < angle, axis=1)]
