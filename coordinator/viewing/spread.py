"""How far the hypotheses of a frame lie apart, joint by joint, as ellipsoids."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

SMALLEST = 0.002  # metres, so that a joint all agree on can still be seen


def ellipsoids(joints: Array, reported: Array, weights: Array) -> tuple[Array, Array]:
    """One standard deviation of joints (M, J, 3) with weights (M,) about the reported (J, 3).

    Returns:
        Half axes (J, 3), metres, and the rotations (J, 4) of those axes as quaternions x, y, z, w.
    """
    away = joints - reported
    covariance = np.einsum("m,mji,mjk->jik", weights / weights.sum(), away, away)
    squares, axes = np.linalg.eigh(covariance)
    axes[np.linalg.det(axes) < 0.0, :, 0] *= -1.0
    return np.maximum(np.sqrt(np.maximum(squares, 0.0)), SMALLEST), Rotation.from_matrix(axes).as_quat()
