"""Particles that came down into the same valley become one hypothesis (step 6)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.compiling import numba
from common.kinematics.chain import contiguous
from common.kinematics.manifold import ball_vector
from common.kinematics.rotations import handedness

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def merge(model: BodyModel, poses: Array, log_likelihood: Array, angle: float) -> tuple[Indices, Indices]:
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
    order = np.argsort(-log_likelihood, kind="stable")
    chosen, group = np.empty_like(order), np.empty_like(order)
    count = join_in_order(
        order, contiguous(poses), angle, find_hinges(model), model.axes, model.balls, chosen, group
    )
    return chosen[:count], group


@lru_cache(maxsize=16)
def find_hinges(model: BodyModel) -> Indices:
    """Degrees of freedom that turn and are no part of a ball."""
    return np.flatnonzero((model.kinds == ROTATION) & model.single)


@numba.njit(cache=True, nogil=True)
def join_in_order(
    order: Indices,
    poses: Array,
    angle: float,
    hinges: Indices,
    axes: Array,
    balls: Indices,
    chosen: Indices,
    group: Indices,
) -> int:
    """Fill chosen and group (N,) as `merge` gives them; the number of representatives."""
    count = 0
    for n in order:
        group[n] = count
        for m in range(count):
            if is_near(poses[n], poses[chosen[m]], angle, hinges, axes, balls):
                group[n] = m
                break
        if group[n] == count:
            chosen[count] = n
            count += 1
    return count


@numba.njit(cache=True, nogil=True)
def is_near(pose: Array, other: Array, angle: float, hinges: Indices, axes: Array, balls: Indices) -> bool:
    """Whether two poses (D,) differ by less than `angle` in every rotation.

    Single axes separate most already, by a subtraction; balls need matrices.
    """
    for j in hinges:
        if not abs(other[j] - pose[j]) < angle:
            return False
    for start in balls:
        x, y, z = ball_vector(handedness(axes, start), pose, other, start)
        if not (abs(x) < angle and abs(y) < angle and abs(z) < angle):
            return False
    return True
