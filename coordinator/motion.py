"""Where particles go between frames: constant velocity plus Gaussian noise (step 3)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import retract

Array = NDArray[np.float64]


def propagate(model: BodyModel, poses: Array, velocities: Array, noise: Array) -> Array:
    """Poses (N, D) moved by their velocities (N, D) and then by noise (N, D)."""
    return retract(model, retract(model, poses, velocities), noise)


def draw_noise(
    covariances: Array,
    ancestors: NDArray[np.int64],
    rng: np.random.Generator,
    spread: NDArray[np.bool_] | None = None,
) -> Array:
    """Gaussian noise (N, D), each with its ancestor's covariance (M, D, D), drawn in particle order.

    The square root is symmetric, so covariances of low rank are drawn from exactly. Particles that are not to
    be `spread` (N,) get none, and their ancestors need no root.
    """
    standard = rng.standard_normal((len(ancestors), covariances.shape[1]))
    noise = np.zeros_like(standard)
    spread = np.ones(len(ancestors), dtype=np.bool_) if spread is None else spread
    parents, place = np.unique(ancestors[spread], return_inverse=True)
    values, vectors = np.linalg.eigh(covariances[parents])
    roots = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    noise[spread] = np.einsum("nij,nj->ni", roots[place], standard[spread])
    return noise
