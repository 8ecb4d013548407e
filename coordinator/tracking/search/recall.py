"""Where a body may be again that was seen before: in the posture it had, at its new place, however turned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import pose_vertices
from common.kinematics.rotations import euler_angles, euler_matrix
from coordinator.tracking.search.candidates import Alike, look_straight
from coordinator.tracking.search.library import stride
from coordinator.tracking.search.signature import CELL, COLUMNS, ROWS, sign

Array = NDArray[np.float64]

TURNS = 4  # about the root's second axis, which is upright in a person


def recall(model: BodyModel, pose: Array, points: Array) -> Alike:
    """A body as it was in pose (D,), with its middle where points (P, 3) are observed, turned TURNS times."""
    turn = look_straight(points.mean(axis=0), 0.0)
    poses = turned(pose)
    surfaces = pose_vertices(model, poses)[:, :: stride(model)]
    seen = middle(points @ turn.T)
    for each, surface in zip(poses, surfaces, strict=True):
        each[:3] += (seen - middle(surface @ turn.T)) @ turn
    return Alike(poses, np.zeros(TURNS, dtype=np.int64), np.zeros(TURNS))


def turned(pose: Array) -> Array:
    """A pose (D,) turned about its root's second axis (TURNS, D), evenly all round."""
    poses = np.tile(pose, (TURNS, 1))
    for n, each in enumerate(poses):
        about = euler_matrix(np.array([0.0, 2.0 * np.pi * n / TURNS, 0.0]))
        each[3:6] = euler_angles(euler_matrix(pose[3:6]) @ about, pose[3:6])
    return poses


def middle(points: Array) -> Array:
    """The middle (3,) of what is seen of points (P, 3) along the third axis, as people's library has it."""
    found = np.empty(3)
    sign(np.ascontiguousarray(points), CELL, np.empty((ROWS, COLUMNS), dtype=np.float32), found)
    return found
