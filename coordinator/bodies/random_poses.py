"""Poses of which nothing is known but the ranges of the joints."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.kinematics.rotations import euler_angles


def draw_within_limits(model: BodyModel, count: int, rng: np.random.Generator) -> Array:
    """Poses (N, D) of `draw_joints`, with the root at the origin in any orientation."""
    poses = draw_joints(model, count, rng)
    poses[:, model.root[3:]] = draw_orientations(count, rng)
    return poses


def draw_joints(model: BodyModel, count: int, rng: np.random.Generator) -> Array:
    """Poses (N, D): joints uniformly distributed over their ranges, or full turns if they have no limits.

    The degrees of freedom of the root are zero.
    """
    low, high = model.limits.T
    whole = np.where(model.kinds == ROTATION, np.pi, 0.5)
    low, high = np.where(np.isfinite(low), low, -whole), np.where(np.isfinite(high), high, whole)
    poses = rng.uniform(low, high, size=(count, len(low)))
    poses[:, np.isin(model.dof_names, ROOT_DOFS)] = 0.0
    return poses


def draw_orientations(count: int, rng: np.random.Generator) -> Array:
    """Angles (N, 3) of uniformly distributed rotations."""
    axis, other = rng.standard_normal((2, count, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    other -= np.sum(other * axis, axis=-1, keepdims=True) * axis
    other /= np.linalg.norm(other, axis=-1, keepdims=True)
    rotations = np.stack([axis, other, np.cross(axis, other)], axis=-1)
    return np.array([euler_angles(rotation, np.zeros(3)) for rotation in rotations]).reshape(count, 3)
