"""Answers of workers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.refinement import Refined


def sure(poses: Array) -> NDArray[np.float32]:
    """Roots of covariances of poses (N, D): a deviation of 0.01 in every direction."""
    dofs = poses.shape[1]
    root = 0.01 * np.eye(dofs, dtype=np.float32)[np.tri(dofs, dtype=np.bool_)]
    return np.tile(root, (len(poses), 1))


def as_bytes(refined: Refined) -> list[bytes]:
    """All results of each particle."""
    results = refined.poses, refined.log_likelihood, refined.residual, refined.covariance_roots
    columns = [column for column in results if column is not None]
    return [b"".join(column[n].tobytes() for column in columns) for n in range(len(refined.poses))]
