"""The motion model between frames (step 3): velocity and Gaussian noise."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.compiling import numba
from gepf.common.kinematics import difference, retract, within_limits
from gepf.common.refinement import WEAK_SHAPE, WEAK_SLIDE, WEAK_TURN
from gepf.coordinator.filters.belief import USUAL_INTERVAL


def draw_noise(covariances: Array, ancestors: Indices, rng: np.random.Generator) -> Array:
    """Gaussian noise (N, D), each with the covariance (M, D, D) of its ancestor, in particle order."""
    standard = rng.standard_normal((len(ancestors), covariances.shape[1]))
    return np.asarray((cholesky(covariances)[ancestors] @ standard[..., None])[..., 0])


@numba.njit(cache=True, nogil=True)
def cholesky(covariances: Array) -> Array:
    """Cholesky factors (M, D, D) of covariances of any rank; a linearly dependent column is zero."""
    roots = np.zeros_like(covariances)
    for m in range(len(covariances)):
        covariance, root = covariances[m], roots[m]
        for j in range(len(root)):
            left = covariance[j, j]
            for k in range(j):
                left -= root[j, k] * root[j, k]
            if left <= len(root) * np.finfo(np.float64).eps * covariance[j, j]:
                continue
            root[j, j] = np.sqrt(left)
            for i in range(j + 1, len(root)):
                total = covariance[i, j]
                for k in range(j):
                    total -= root[i, k] * root[j, k]
                root[i, j] = total / root[j, j]
    return roots


def fuse_with_prediction(
    model: BodyModel, refined: Array, covariances: Array, expected: Array, interval: float, turn_deg: float
) -> Array:
    """The most likely poses (M, D) given a frame and the motion prior.

    Refinement uses one frame. An occluded limb is determined only by the prior of joint angles, which would
    pull it to rest within a few frames. So each hypothesis is moved to the maximum of the posterior of frame
    and motion: visible limbs follow the frame, occluded limbs follow the prediction. A refined pose has the
    covariance S = (L + W)^-1, with the precision L of the frame and W of the weak prior. With the precision P
    of motion, the step is (I + S (P - W))^-1 S P (predicted - refined), without L. The frame alone determines
    the pose of the base; shape does not move.

    Args:
        model: The body.
        refined: Hypotheses (M, D) after refinement.
        covariances: Their covariances (M, D, D) by the refinement.
        expected: Poses (M, D) predicted by the motion model.
        interval: Seconds of the motion.
        turn_deg: Standard deviation of a joint angle around its prediction after a usual interval.
    """
    weak, moves = weak_precisions(model), motion_precisions(model, turn_deg)
    base = np.isin(model.dof_names, ROOT_DOFS) | ~model.moves  # and shape
    motion: Array = np.where(base, weak, moves / interval)
    step: Array = np.where(base, 0.0, difference(model, refined, expected))
    pull = covariances @ (motion * step)[..., None]
    matrix: Array = np.eye(len(motion)) + covariances * (motion - weak)
    steps = np.asarray(np.linalg.solve(matrix, pull), dtype=np.float64)
    return within_limits(model, retract(model, refined, steps[..., 0]))


@lru_cache(maxsize=16)
def weak_precisions(model: BodyModel) -> Array:
    """Inverse variances (D,) of the weak prior."""
    deviations = np.where(model.moves, WEAK_SLIDE, WEAK_SHAPE)
    precisions: Array = np.where(model.kinds == ROTATION, WEAK_TURN, deviations) ** -2.0
    return precisions


@lru_cache(maxsize=16)
def motion_precisions(model: BodyModel, turn_deg: float) -> Array:
    """Inverse variances (D,) of the motion in one second; prismatic joints have those of the weak prior."""
    deviations = np.where(model.kinds == ROTATION, float(np.radians(turn_deg)), WEAK_SLIDE)
    precisions: Array = deviations**-2.0 * USUAL_INTERVAL
    return precisions
