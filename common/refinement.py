"""Particles before and after their refinement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices
from gepf.common.settings import RefineSettings

WEAK_TURN, WEAK_SLIDE, WEAK_SHAPE = float(np.radians(30.0)), 0.05, 1.0
"""Standard deviations, radians and metres, of the weak prior in every covariance of a pose."""

KEYPOINT_OUTLIER = 3.0
"""Scale of the robust kernel of keypoints, in their standard deviations."""

KEYPOINT_WEIGHT = 0.25
"""Weight of a keypoint in the log posterior: the 17 errors in an image share causes, and count as four."""


@dataclass(frozen=True, slots=True, eq=False)
class PosePrior:
    """A Gaussian prior of the refined pose, in relative motion from its mean.

    Half the squared distance, weighted by the precision, counts as nats of the log posterior. The precision
    is positive semidefinite, and diagonal or dense.
    """

    mean: Array  # (D,), or (N, D) for each particle
    precision: Array  # (D,) or (D, D) inverse (co)variance, radians and metres


@dataclass(frozen=True, slots=True, eq=False)
class Particles:
    """Particles to refine, and how."""

    poses: Array  # (N, D) metres and radians
    settings: RefineSettings
    covariance: bool = False  # whether the covariance of each refined pose is requested
    spare: bool = False  # whether other requests come first
    velocity: Array | None = None
    """Relative motion (D,) per second, for cameras whose time differs from the frame's; None: no motion."""
    prior: PosePrior | None = None

    def part(self, start: int, stop: int) -> Particles:
        """Particles start to stop - 1."""
        prior = self.prior
        if prior is not None and prior.mean.ndim == 2:
            prior = replace(prior, mean=prior.mean[start:stop])
        return replace(self, poses=self.poses[start:stop], prior=prior)


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """Refined particles; the first axis of every array is the particle."""

    poses: Array  # (N, D) metres and radians
    log_likelihood: Array  # (N,)
    residual: Array  # (N,) metres, mean distance of observed points from the model
    covariance_roots: NDArray[np.float32] | None = None
    """Lower triangles (N, D (D + 1) / 2) of Cholesky factors of the covariances, in relative motion.

    None if not requested.
    """

    def take(self, particles: Indices) -> Refined:
        """The particles with these indices, in this order."""
        roots = None if self.covariance_roots is None else self.covariance_roots[particles]
        return Refined(self.poses[particles], self.log_likelihood[particles], self.residual[particles], roots)


def concatenate(parts: list[Refined]) -> Refined:
    """Concatenate batches with the same arrays, in this order."""
    roots = [part.covariance_roots for part in parts if part.covariance_roots is not None]
    return Refined(
        np.concatenate([part.poses for part in parts]),
        np.concatenate([part.log_likelihood for part in parts]),
        np.concatenate([part.residual for part in parts]),
        np.concatenate(roots) if roots else None,
    )


def triangle_size(side: int) -> int:
    """Number of entries of a square matrix on and below its diagonal."""
    return side * (side + 1) // 2


def lower_triangular(triangles: NDArray[np.float32], side: int) -> Array:
    """Matrices (N, D, D), zero above the diagonal, from their lower triangles (N, D (D + 1) / 2)."""
    matrices = np.zeros((len(triangles), side, side))
    matrices[:, np.tri(side, dtype=np.bool_)] = triangles
    return matrices
