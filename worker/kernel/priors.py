"""Priors of a pose: joint limits, and a Gaussian prior around the rest pose."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.common.kinematics.manifold import step_between
from gepf.common.kinematics.rotations import handedness
from gepf.worker.kernel.surface import Skeleton

LIMIT_WEIGHT_M2 = 0.002  # of a squared radian outside the limits of a spherical joint, per point


@numba.njit(cache=True, nogil=True)
def prior_cost(skeleton: Skeleton, pose: Array, rest_weight: float) -> float:
    """Cost of pose (D,) per point (m^2) by the priors: distance from rest, and violated limits.

    `add_prior` adds half of it, with the derivatives, to the equations.
    """
    cost, excess = 0.0, np.empty(3)
    if rest_weight > 0.0:
        away = step_between(skeleton.axes, skeleton.balls, np.zeros_like(pose), pose)
        cost += rest_weight * np.sum(skeleton.precisions * away**2)
    for start in skeleton.balls:
        if fill_excess(skeleton, pose, start, excess):
            cost += LIMIT_WEIGHT_M2 * (excess[0] ** 2 + excess[1] ** 2 + excess[2] ** 2)
    return cost


@numba.njit(cache=True, nogil=True)
def add_prior(
    skeleton: Skeleton, pose: Array, rest_weight: float, points: int, gram: Array, gradient: Array
) -> None:
    """Add half the cost of the priors, for this number of points, to the equations at pose (D,).

    With R = R_1 R_2 R_3 a small rotation d of a spherical joint along its axes changes its angles by E^-1 d,
    E = [a_1, R_1 a_2, R_1 R_2 a_3].
    """
    if rest_weight > 0.0:
        away = step_between(skeleton.axes, skeleton.balls, np.zeros_like(pose), pose)
        for j in range(len(pose)):
            stiffness = rest_weight * points * skeleton.precisions[j]
            gram[j, j] += stiffness
            gradient[j] += stiffness * away[j]
    excess = np.empty(3)
    for start in skeleton.balls:
        if fill_excess(skeleton, pose, start, excess):
            handed = handedness(skeleton.axes, start)
            sa, ca = np.sin(handed * pose[start]), np.cos(pose[start])
            sb, cb = np.sin(handed * pose[start + 1]), np.cos(pose[start + 1])
            rates = np.array(((1.0, sa * sb / cb, -ca * sb / cb), (0.0, ca, sa), (0.0, -sa / cb, ca / cb)))
            for a in range(3):
                if excess[a] != 0.0:
                    for b in range(3):
                        stiffness = LIMIT_WEIGHT_M2 * points * rates[a, b]
                        gradient[start + b] += stiffness * excess[a]
                        for c in range(3):
                            gram[start + b, start + c] += stiffness * rates[a, c]


@numba.njit(cache=True, nogil=True)
def fill_excess(skeleton: Skeleton, pose: Array, start: int, excess: Array) -> bool:
    """Fill excess (3,) of a spherical joint's angles over their limits; whether there is valid excess.

    If the middle angle is near 90 degrees, the other angles are arbitrary.
    """
    outside = False
    for a in range(3):
        angle, low, high = pose[start + a], skeleton.limits[start + a, 0], skeleton.limits[start + a, 1]
        excess[a] = angle - min(max(angle, low), high)
        outside = outside or excess[a] != 0.0
    return outside and abs(np.cos(pose[start + 1])) > 0.3


@numba.njit(cache=True, nogil=True)
def hold_active_limits(skeleton: Skeleton, pose: Array, gram: Array, gradient: Array) -> None:
    """Remove single axes at a limit from the equations if the gradient leads beyond it (active set)."""
    for j in range(len(pose)):
        low = pose[j] <= skeleton.limits[j, 0] and gradient[j] > 0.0
        high = pose[j] >= skeleton.limits[j, 1] and gradient[j] < 0.0
        if skeleton.single[j] and (low or high):
            gram[j, :] = 0.0
            gram[:, j] = 0.0
            gram[j, j] = 1.0
            gradient[j] = 0.0
