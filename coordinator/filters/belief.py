"""What any method knows after a frame: weighted poses, where each is going, and the pose it reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.kinematics import difference, joint_positions, retract
from coordinator.filters.resampling import normalise

Array = NDArray[np.float64]

USUAL_SPEED = 1.8
"""Metres a second, root mean square over the joints: how fast the reported pose usually moves."""


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Weighted poses after a frame, likeliest first, and the one that stands for them."""

    poses: Array  # (M, D)
    log_weights: Array  # (M,)
    residual: Array  # (M,) metres
    velocities: Array  # (M, D) relative motion per second
    reported: Array  # (D,)

    @property
    def weights(self) -> Array:
        """Normalised weights (M,)."""
        return normalise(self.log_weights)

    def at_rest(self) -> Self:
        """The same poses, going nowhere."""
        return replace(self, velocities=np.zeros_like(self.velocities))


def mean_pose(model: BodyModel, poses: Array, weights: Array) -> Array:
    """Weighted mean (D,) of poses (M, D), taken as relative motion about the first; weights sum to 1."""
    apart = difference(model, np.broadcast_to(poses[:1], poses.shape), poses)
    mean: Array = retract(model, poses[:1], weights[None] @ apart)[0]
    return mean


def likeliest_way_on(
    model: BodyModel, last: Array, poses: Array, log_likelihood: Array, interval: float
) -> Array:
    """The pose (D,) of hypotheses (M, D) that is likeliest given a frame (M,) and the pose (D,) before it.

    Hypotheses that explain the frames about equally well change places from one to the next; how far the
    joints would have to move decides between them, and hardly between others.
    """
    joints = joint_positions(model, np.concatenate([last[None], poses]))
    way_on: Array = poses[likeliest_after(joints, log_likelihood, USUAL_SPEED * interval)]
    return way_on


@numba.njit(cache=True, nogil=True)
def likeliest_after(joints: Array, log_likelihood: Array, usual: float) -> int:
    """Which of joints (M + 1, J, 3) but the first, from where they usually move so far, is the likeliest."""
    best, most = 0, -np.inf
    for m in range(len(log_likelihood)):
        squares = 0.0
        for j in range(joints.shape[1]):
            for a in range(3):
                squares += (joints[m + 1, j, a] - joints[0, j, a]) ** 2
        likely = log_likelihood[m] - 0.5 * squares / max(1, joints.shape[1]) / usual**2
        if likely > most:
            best, most = m, likely
    return best
