"""The types of all methods: the belief after a frame, the observation of the next one, and its particles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.kinematics import difference, joint_positions, retract
from gepf.common.settings import RefineSettings

USUAL_INTERVAL = 1.0 / 30.0  # seconds between frames


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """Weighted poses after a frame, the most likely first, and the reported pose."""

    poses: Array  # (M, D)
    log_weights: Array  # (M,)
    residual: Array  # (M,) metres
    velocities: Array  # (M, D) relative motion per second
    reported: Array  # (D,)
    covariances: Array = field(default_factory=lambda: np.empty((0, 0, 0)), kw_only=True)
    """Covariances (M, D, D) of the modes, in relative motion; empty for methods that have none."""
    posterior: Array = field(default_factory=lambda: np.empty((0, 0)), kw_only=True)
    """Covariance (D, D) of the reported pose by its refinement, in relative motion; empty if unknown."""
    shape_precision: Array = field(default_factory=lambda: np.empty((0, 0)), kw_only=True)
    """Precision (S, S) of the shape coefficients, from all frames so far."""

    @classmethod
    def at(cls, pose: Array, **fields: Array) -> Self:
        """The belief in one pose (D,) at rest."""
        zero = np.zeros((1, len(pose)))
        return cls(pose[None].copy(), np.zeros(1), np.full(1, np.nan), zero, pose.copy(), **fields)

    @property
    def weights(self) -> Array:
        """Normalised weights (M,)."""
        return normalise(self.log_weights)

    @property
    def velocity(self) -> Array:
        """Relative motion (D,) per second of the reported pose."""
        return np.asarray(self.velocities[self.reported_index])

    @property
    def reported_index(self) -> int:
        """The hypothesis that is reported; for methods that report a mean, the nearest one."""
        return nearest_pose(self.poses, self.reported)

    def at_rest(self) -> Self:
        """The same poses with zero velocity."""
        return replace(self, velocities=np.zeros_like(self.velocities))

    def unseen(self) -> Self:
        """After a frame that does not show the body: the same poses, at rest and without residual."""
        return replace(self.at_rest(), residual=np.full(len(self.residual), np.nan))


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """The data of a frame that are used for drawing its particles."""

    points: Array  # (P, 3) camera frame, metres
    interval: float  # seconds since the frame before
    step: Array | None  # (D,) relative motion since then, from encoders or colour; NaN if unknown
    cameras: int  # that show the body
    unseen: Mask | None = None  # (D,) degrees of freedom that move only what is out of view; None: none

    def expect(self, motion: Array) -> Array:
        """The predicted motion (M, D) since the previous frame, replaced by `step` where that is known."""
        return motion if self.step is None else np.where(np.isnan(self.step), motion, self.step)


def nearest_pose(poses: Array, pose: Array) -> int:
    """The index of the pose among (M, D) that differs least from a pose (D,)."""
    return int(np.argmin(np.abs(poses - pose).sum(axis=1)))


def zero_log_prior(poses: Array) -> Array:
    """The log prior (N,) of poses (N, D) if there is none: zero."""
    return np.zeros(len(poses))


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """Particles of a frame before refinement, drawn from the belief of the frame before."""

    past: Belief
    ancestors: Indices  # (N,) the pose of `past` that each particle was drawn from
    poses: Array  # (N, D)
    interval: float  # seconds since the frame of `past`
    expected: Array | None = field(default=None, kw_only=True)
    """Predictions (N, D) without noise, if the update needs the covariance of each pose."""
    unseen: Mask | None = field(default=None, kw_only=True)  # as in `Observation`
    merges_early: bool = field(default=False, kw_only=True)
    """Whether particles are merged after their first iterations, and the representatives refined further."""
    log_prior: Callable[[Array], Array] = field(default=zero_log_prior, kw_only=True)
    """The part (N,) of the log likelihood of refined poses (N, D) that is a prior of the family of bodies."""

    def asks_covariance(self, rules: RefineSettings) -> bool:
        """Whether the covariance of each refined pose is requested from the workers.

        It is unreliable with soft correspondences, and without iterations it is only the prior.
        """
        return self.expected is not None and not rules.is_soft and rules.icp_iterations > 0


def normalise(log_weights: Array) -> Array:
    """Weights (M,) that sum to 1. If all log weights are -inf, all weights are equal."""
    if not np.any(np.isfinite(log_weights)):
        return np.full(len(log_weights), 1.0 / len(log_weights))
    weights = np.exp(log_weights - np.max(log_weights))
    return np.asarray(weights / weights.sum())


def draw_ancestors(weights: Array, count: int, rng: np.random.Generator) -> Indices:
    """Ancestors (count,), ascending, by systematic resampling: each is drawn about w * count times.

    A hypothesis with zero weight is never drawn.
    """
    sums = np.cumsum(weights)
    places = (np.arange(count) + rng.random()) / count * sums[-1]
    last = np.flatnonzero(weights)[-1]
    return np.asarray(np.minimum(np.searchsorted(sums, places, side="right"), last))


def mean_pose(model: BodyModel, poses: Array, weights: Array) -> Array:
    """Weighted mean (D,) of poses (M, D), in relative motion from the first; weights sum to 1."""
    apart = difference(model, poses[:1], poses)
    return np.asarray(retract(model, poses[:1], weights[None] @ apart)[0])


def choose_reported(
    model: BodyModel, last: Array, poses: Array, log_likelihood: Array, interval: float, usual_speed: float
) -> Array:
    """The most likely of poses (M, D), given log likelihoods (M,) in a frame and the last reported pose.

    Hypotheses of nearly equal likelihood can change their order between frames. A penalty on motion breaks
    such ties and rarely affects other cases. The usual speed is in metres per second, root mean square over
    the joints.
    """
    joints = joint_positions(model, np.concatenate([last[None], poses]))
    square = np.sum((joints[1:] - joints[0]) ** 2, axis=-1).mean(axis=-1)
    return np.asarray(poses[np.argmax(log_likelihood - 0.5 * square / (usual_speed * interval) ** 2)])
