"""The Gaussian priors of pose, shape and motion, and the models of motion.

A request for refinement brings along the prior of the pose, `pose_prior`.

Joints are near rest, the base is anywhere, and the shape is what earlier frames showed. Shape is constant,
but errors of successive frames are not independent, because they follow from pose and clothes. All frames
within `error_time_s` together count as one. So the precision P of the earlier frames is divided by the share
k of a frame, which makes the refinement the recursive estimate of a constant from frames with the share k of
their information I. With the covariance S of the shape by the refinement, k I = k S^-1 - P. The precision
after the frame is P + c k I. The factor c is needed because the Gauss-Newton matrix overstates the
information: it treats correspondences as fixed, although they slide along the surface.

The prior of motion between frames is step 3 of the paper: the motion that a model predicts, and Gaussian
noise (`draw_noise`, `fuse_with_prediction`). The state of a motion model is the velocities of the hypotheses.
Motion that is known from encoders or colour replaces the predicted motion (`Observation.expect`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.body import ROOT_DOFS, ROTATION, SHAPE, BodyModel
from gepf.common.compiling import numba
from gepf.common.kinematics import difference, retract, within_limits
from gepf.common.refinement import WEAK_SHAPE, WEAK_SLIDE, WEAK_TURN, PosePrior
from gepf.common.settings import RefineSettings
from gepf.coordinator.filters.belief import USUAL_INTERVAL, Belief
from gepf.coordinator.settings import FilterSettings, ShapeSettings


def pose_prior(
    model: BodyModel, settings: RefineSettings, poses: Array | None = None, precision: Array | None = None
) -> PosePrior | None:
    """The prior for the refinement of poses (N, D) or (D,), whose shape has the precision (S, S).

    The pull of a joint towards rest is bounded: it is that at a distance of `max_rest_pull` deviations if the
    pose is farther away (Huber). Without poses, bodies are at rest. Without a precision of the shape, that of
    the population around each shape is taken. None if there is no prior at all.
    """
    count, dofs = model.shape_count, len(model.dof_names)
    if not (settings.has_joint_prior or count):
        return None
    here = np.zeros(dofs) if poses is None else poses
    deviations = rest_deviations(model, settings)
    mean, rests, diagonal = np.zeros_like(here), np.isfinite(deviations), deviations**-2.0
    reach = settings.max_rest_pull * deviations[rests]
    mean[..., rests] = here[..., rests] - np.clip(here[..., rests], -reach, reach)
    if not count:
        return PosePrior(mean, diagonal)
    mean[..., :count], matrix = here[..., :count], np.diag(diagonal)
    matrix[:count, :count] = population_precision(model) if precision is None else precision
    return PosePrior(mean, matrix)


def log_rest_prior(model: BodyModel, settings: RefineSettings, poses: Array) -> Array:
    """What the log density (N,) of poses (N, D) under the Gaussian around rest has beyond the refinement's.

    It counts between the candidates of a search: depth decides the angle of a joint that it shows, but the
    whole prior decides which of several poses is likelier.
    """
    off = poses / rest_deviations(model, settings)
    return np.asarray(-0.5 * np.sum(np.maximum(0.0, off**2 - settings.max_rest_pull**2), axis=1))


def rest_deviations(model: BodyModel, settings: RefineSettings) -> Array:
    """Standard deviations (D,) of joints around rest; infinite for the base, shape, and without a prior."""
    free = np.isin(model.dof_names, ROOT_DOFS) | (model.kinds == SHAPE) | (not settings.has_joint_prior)
    return np.where(free, np.inf, max(settings.pose_deviation, 1e-9) * model.rest_spreads)


def population_precision(model: BodyModel) -> Array:
    """Precision (S, S) of a person's shape around the detected shape, from the population."""
    precision: Array = np.diag(model.rest_spreads[: model.shape_count] ** -2.0)
    return precision


def frame_share(interval: float, error_time_s: float) -> float:
    """The share of a frame's information that counts, `interval` seconds after the previous frame."""
    return min(1.0, interval / error_time_s)


def updated_precision(precision: Array, covariance: Array, interval: float, settings: ShapeSettings) -> Array:
    """Precision (S, S) of the shape after a frame, from its covariance (S, S) in the refinement."""
    gain = frame_share(interval, settings.error_time_s) * np.linalg.inv(covariance) - precision
    after: Array = precision + settings.curvature_share * gain
    return 0.5 * (after + after.T)


class MotionModel(Protocol):
    """A model of the motion between frames; all motion is relative, in radians and metres."""

    def predict(self, past: Belief, interval: float) -> Array:
        """The expected motion (M, D) of the poses of a belief within an interval, seconds."""
        ...

    def update(self, motion: Array, interval: float) -> Array:
        """Velocities (M, D), per second, of hypotheses that moved by `motion` (M, D) within an interval."""
        ...


@dataclass(frozen=True, slots=True)
class ConstantVelocity:
    """The velocity of the last motion, which decays, so that the end of a swing is not overshot."""

    decay_s: float | None  # time constant; None: no decay

    def predict(self, past: Belief, interval: float) -> Array:
        """The motion at the velocity that is left after the interval."""
        share = 1.0 if self.decay_s is None else np.exp(-interval / self.decay_s)
        motion: Array = share * interval * past.velocities
        return motion

    def update(self, motion: Array, interval: float) -> Array:
        """The mean velocity."""
        return motion / interval


def motion_model(settings: FilterSettings) -> MotionModel:
    """The motion model of the settings."""
    return ConstantVelocity(settings.velocity_time_s)


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
