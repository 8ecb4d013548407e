"""What is known of a pose without an observation: joint limits, and a prior towards the rest pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.kinematics.rotations import euler_matrix, fill_euler_matrix, handedness, rotation_vector
from worker.kernel.surface import Skeleton

Array = NDArray[np.float64]

LIMIT_SHARE = 0.002  # weight of a squared radian outside a ball's limits, for each point


@numba.njit(cache=True, nogil=True)
def prior_cost(skeleton: Skeleton, pose: Array, rest_weight: float) -> float:
    """What pose (D,) costs for each point (m^2), whatever is observed: far from rest, or out of limits.

    It is what `add_rest_prior` and `add_limit_prior` add half of, with the derivatives, to the equations.
    """
    cost = 0.0
    if rest_weight > 0.0:
        away = away_from_rest(skeleton, pose)
        for j in range(len(pose)):
            cost += rest_weight * skeleton.precisions[j] * away[j] * away[j]
    excess = np.empty(3)
    for start in skeleton.balls:
        if fill_excess(skeleton, pose, start, excess):
            cost += LIMIT_SHARE * (excess[0] ** 2 + excess[1] ** 2 + excess[2] ** 2)
    return cost


@numba.njit(cache=True, nogil=True)
def away_from_rest(skeleton: Skeleton, pose: Array) -> Array:
    """How far each angle of pose (D,) is from rest; of a ball, its rotation vector."""
    away, turned = pose.copy(), np.empty((3, 3))
    for start in skeleton.balls:
        handed = handedness(skeleton.axes, start)
        fill_euler_matrix(handed * pose[start], handed * pose[start + 1], handed * pose[start + 2], turned)
        x, y, z = rotation_vector(turned)
        away[start], away[start + 1], away[start + 2] = handed * x, handed * y, handed * z
    return away


@numba.njit(cache=True, nogil=True)
def add_rest_prior(skeleton: Skeleton, pose: Array, stiffness: float, gram: Array, gradient: Array) -> None:
    """Add half the squared angles of all joints, by their precisions, to the equations (rest prior)."""
    away = away_from_rest(skeleton, pose)
    for j in range(len(pose)):
        stiff = stiffness * skeleton.precisions[j]
        gram[j, j] += stiff
        gradient[j] += stiff * away[j]


@numba.njit(cache=True, nogil=True)
def fill_excess(skeleton: Skeleton, pose: Array, start: int, excess: Array) -> bool:
    """Fill excess (3,): how far a ball's angles are beyond their limits; whether any is, and means something.

    Where the middle angle is near 90 degrees the others mean nothing.
    """
    outside = False
    for a in range(3):
        angle, low, high = pose[start + a], skeleton.limits[start + a, 0], skeleton.limits[start + a, 1]
        excess[a] = angle - min(max(angle, low), high)
        outside = outside or excess[a] != 0.0
    return outside and abs(np.cos(pose[start + 1])) > 0.3


@numba.njit(cache=True, nogil=True)
def add_limit_prior(skeleton: Skeleton, pose: Array, stiffness: float, gram: Array, gradient: Array) -> None:
    """Add half the squared excess of each ball's angles over their limits to the equations.

    With R = R_1 R_2 R_3 a small turn d of the ball changes its angles by E^-1 d, E = [a_1, R_1 a_2,
    R_1 R_2 a_3] along the ball's axes. Where E is nearly singular the angles mean nothing and are let be.
    """
    excess = np.empty(3)
    for start in skeleton.balls:
        if fill_excess(skeleton, pose, start, excess):
            rates = np.linalg.inv(euler_rates(pose[start : start + 3], handedness(skeleton.axes, start)))
            for a in range(3):
                if excess[a] != 0.0:
                    for b in range(3):
                        gradient[start + b] += stiffness * rates[a, b] * excess[a]
                        for c in range(3):
                            gram[start + b, start + c] += stiffness * rates[a, b] * rates[a, c]


@numba.njit(cache=True, nogil=True)
def euler_rates(angles: Array, handed: float) -> Array:
    """E (3, 3): turn of Rx(a) Ry(b) Rz(c), along the ball's axes, per change of its angles."""
    first = euler_matrix(np.array([handed * angles[0], 0.0, 0.0]))
    second = euler_matrix(np.array([handed * angles[0], handed * angles[1], 0.0]))
    rates = np.zeros((3, 3))
    rates[0, 0] = 1.0
    rates[:, 1] = first[:, 1]
    rates[:, 2] = second[:, 2]
    return rates


@numba.njit(cache=True, nogil=True)
def hold_active_limits(skeleton: Skeleton, pose: Array, gram: Array, gradient: Array) -> None:
    """Take out of the equations the single axes at a limit whose gradient leads beyond it (active set)."""
    for j in range(len(pose)):
        low = pose[j] <= skeleton.limits[j, 0] and gradient[j] > 0.0
        high = pose[j] >= skeleton.limits[j, 1] and gradient[j] < 0.0
        if skeleton.single[j] and (low or high):
            gram[j, :] = 0.0
            gram[:, j] = 0.0
            gram[j, j] = 1.0
            gradient[j] = 0.0
