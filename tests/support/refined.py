"""Results of refinement that are there at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.refinement import Refined
from coordinator.pool.statistics import PoolStatistics
from gepf.direct import DirectRefiner


def sure(poses: NDArray[np.float64], *, asked: bool = True) -> NDArray[np.float32] | None:
    """Roots of covariances of poses (N, D), 0.01 in every direction, if they are asked for."""
    dofs = poses.shape[1]
    root = 0.01 * np.eye(dofs, dtype=np.float32)[np.tri(dofs, dtype=np.bool_)]
    return np.tile(root, (len(poses), 1)) if asked else None


@dataclass(frozen=True, slots=True, eq=False)
class Ready:
    """Particles that nobody needs to wait for."""

    refined: Refined

    def result(self) -> Refined:
        """The particles."""
        return self.refined


class Direct(DirectRefiner):
    """Refines in this process, and has no statistics."""

    statistics = PoolStatistics()
