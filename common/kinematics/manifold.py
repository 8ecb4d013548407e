"""Poses as points of a manifold: steps of relative motion, the step between two poses, limits of joints.

A pose is a vector of joint values; a *step* is a vector of relative motion about axes in the camera frame.
For a single axis the step is added to the joint value. For a spherical joint (three rotations about
orthonormal axes through one point, so also the root) the step is one rotation vector along the axes as the
parent link carries them, which has no singular pose. Of the joint values after it, those of the branch
nearest to the old values are taken.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.compiling import numba
from gepf.common.kinematics.chain import contiguous
from gepf.common.kinematics.rotations import (
    euler_angles,
    fill_euler_matrix,
    fill_rotation,
    handedness,
    multiply_by,
    quaternion,
)


def retract(model: BodyModel, poses: Array, steps: Array) -> Array:
    """Poses (N, D) after relative motion by steps (N, D). Inverse of `difference`."""
    moved = contiguous(poses)
    apply_step_each(model.axes, model.balls, contiguous(steps), moved)
    return moved


def difference(model: BodyModel, origins: Array, poses: Array) -> Array:
    """Steps (N, D) that lead from `origins`, (N, D) or one (1, D), to `poses` (N, D).

    Rotations take the shorter way.
    """
    origins = np.broadcast_to(origins, poses.shape)
    return steps_between(model.axes, model.balls, contiguous(origins), contiguous(poses))


@numba.njit(cache=True, nogil=True)
def apply_step(axes: Array, balls: Indices, step: Array, pose: Array) -> None:
    """Move pose (D,) in place by step (D,): add it; rotate spherical joints by rotation vectors."""
    old, before, turn = pose.copy(), np.empty((3, 3)), np.empty((3, 3))
    pose += step
    for start in balls:
        handed = handedness(axes, start)
        x, y, z = step[start], step[start + 1], step[start + 2]
        angle = np.sqrt(x * x + y * y + z * z)
        angles = handed * old[start], handed * old[start + 1], handed * old[start + 2]
        if angle > 1e-15:
            fill_rotation(x / angle, y / angle, z / angle, handed * angle, turn)
            fill_euler_matrix(angles[0], angles[1], angles[2], before)
            multiply_by(turn, before)
            angles = euler_angles(turn, angles)
        x, y, z = angles
        pose[start], pose[start + 1], pose[start + 2] = handed * x, handed * y, handed * z


@numba.njit(cache=True, nogil=True)
def apply_step_each(axes: Array, balls: Indices, steps: Array, poses: Array) -> None:
    """`apply_step` for steps (N, D), poses (N, D) in place."""
    for n in range(len(poses)):
        apply_step(axes, balls, steps[n], poses[n])


@numba.njit(cache=True, nogil=True)
def steps_between(axes: Array, balls: Indices, origins: Array, poses: Array) -> Array:
    """`step_between` for origins (N, D) and poses (N, D)."""
    steps = np.empty_like(poses)
    for n in range(len(poses)):
        steps[n] = step_between(axes, balls, origins[n], poses[n])
    return steps


@numba.njit(cache=True, nogil=True)
def step_between(axes: Array, balls: Indices, before: Array, after: Array) -> Array:
    """The step (D,) that leads from one pose (D,) to another; rotations take the shorter way."""
    step = after - before
    for start in balls:
        handed = handedness(axes, start)
        step[start], step[start + 1], step[start + 2] = ball_vector(handed, before, after, start)
    return step


@numba.njit(cache=True, nogil=True)
def ball_vector(handed: float, before: Array, after: Array, start: int) -> tuple[float, float, float]:
    """The rotation vector of the spherical joint at `start` that leads from one pose (D,) to another."""
    i, j, k = start, start + 1, start + 2
    bw, bx, by, bz = quaternion(handed * before[i], handed * before[j], handed * before[k])
    aw, ax, ay, az = quaternion(handed * after[i], handed * after[j], handed * after[k])
    w = aw * bw + ax * bx + ay * by + az * bz  # after * conjugate of before
    x = ax * bw - aw * bx + az * by - ay * bz
    y = ay * bw - aw * by + ax * bz - az * bx
    z = az * bw - aw * bz + ay * bx - ax * by
    sine = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 * handed if sine < 1e-12 else 2.0 * handed * np.arctan2(sine, abs(w)) / sine
    if w < 0.0:
        scale = -scale
    return scale * x, scale * y, scale * z


def natural_angles(model: BodyModel, poses: Array) -> Array:
    """The same poses (N, D), with the angles of spherical joints on the branch that exceeds the limits least.

    Rx(a) Ry(b) Rz(c) is also Rx(a + pi) Ry(pi - b) Rz(c + pi). Where both are within the limits, angles stay.
    """
    natural = contiguous(poses)
    choose_branch_each(model.balls, model.limits, natural)
    return natural


def within_limits(model: BodyModel, poses: Array) -> Array:
    """Poses (N, D) with single axes clamped to their limits; spherical joints are unchanged."""
    return np.where(model.single, np.clip(poses, *model.limits.T), poses)


@numba.njit(cache=True, nogil=True)
def clamp_to_limits(single: Mask, limits: Array, pose: Array) -> None:
    """Clamp the single axes of pose (D,) to their limits, in place."""
    for j in range(len(pose)):
        if single[j]:
            pose[j] = min(max(pose[j], limits[j, 0]), limits[j, 1])


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
