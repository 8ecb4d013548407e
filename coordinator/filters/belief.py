"""What any method knows after a frame: weighted poses, where each is going, and the pose it reports."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import difference, retract
from coordinator.filters.resampling import normalise

Array = NDArray[np.float64]


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
