"""Poses within the limits of their joints: balls on the branch nearer to them, single axes clamped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.kinematics.arrays import contiguous

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def natural_angles(model: BodyModel, poses: Array) -> Array:
    """The same poses (N, D), each ball's angles on the branch that leaves its limits less.

    Rx(a) Ry(b) Rz(c) is also Rx(a + pi) Ry(pi - b) Rz(c + pi). Where both are within the limits, angles stay.
    """
    natural = contiguous(poses)
    choose_branch_each(model.balls, model.limits, natural)
    return natural


def within_limits(model: BodyModel, poses: Array) -> Array:
    """Poses (N, D) with single axes clamped to their limits; balls are let be."""
    clamped = contiguous(poses)
    clamp_each(model.single, model.limits, clamped)
    return clamped


@numba.njit(cache=True, nogil=True)
def clamp_to_limits(single: NDArray[np.bool_], limits: Array, pose: Array) -> None:
    """Clamp the single axes of pose (D,) to their limits, in place."""
    for j in range(len(pose)):
        if single[j]:
            pose[j] = min(max(pose[j], limits[j, 0]), limits[j, 1])


@numba.njit(cache=True, nogil=True)
def clamp_each(single: NDArray[np.bool_], limits: Array, poses: Array) -> None:
    """`clamp_to_limits` of poses (N, D), in place."""
    for n in range(len(poses)):
        clamp_to_limits(single, limits, poses[n])


@numba.njit(cache=True, nogil=True)
def choose_branch_each(balls: Indices, limits: Array, poses: Array) -> None:
    """`natural_angles` of poses (N, D) in place."""
    near, best = np.empty(3), np.empty(3)
    for n in range(len(poses)):
        for start in balls:
            angles, low, high = poses[n, start : start + 3], limits[start:, 0], limits[start:, 1]
            best[:] = angles
            for flip in range(2):
                for a in range(3):
                    turned = angles[a] if flip == 0 else np.pi + (-angles[a] if a == 1 else angles[a])
                    near[a] = (turned + np.pi) % (2.0 * np.pi) - np.pi
                if excess(near, low, high) < excess(best, low, high) - 1e-9:
                    best[:] = near
            angles[:] = best


@numba.njit(cache=True, nogil=True)
def excess(angles: Array, low: Array, high: Array) -> float:
    """Sum of how far angles (3,) lie outside of their limits."""
    total = 0.0
    for a in range(3):
        total += abs(angles[a] - min(max(angles[a], low[a]), high[a]))
    return total
