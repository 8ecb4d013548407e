"""The particles of a frame before they are refined, and where each came from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.settings import RefineSettings
from coordinator.filters.belief import Belief

B = TypeVar("B", bound=Belief)


@dataclass(frozen=True, slots=True, eq=False)
class Proposal(Generic[B]):
    """Particles drawn from the belief about the frame before; their likelihoods update it."""

    past: B
    ancestors: NDArray[np.int64]  # (N,) the pose of `past` that each particle was drawn from
    poses: NDArray[np.float64]  # (N, D)
    interval: float  # seconds since the frame that `past` is about
    covariance: bool = field(default=False, kw_only=True)
    """Whether the update would know how sure each refined pose is."""
    origins: NDArray[np.float64] | None = field(default=None, kw_only=True)
    """The poses (N, D) that they move on from, where these are not those of their ancestors."""
    expected: NDArray[np.float64] | None = field(default=None, kw_only=True)
    """Where they would be (N, D) without noise, where that is asked for."""

    def asks_covariance(self, rules: RefineSettings) -> bool:
        """Whether the workers are asked for it: not where depth is by far the noisiest, where it misleads.

        Nor where particles do not descend: then it says nothing of the frame.
        """
        return self.covariance and not rules.is_soft and rules.icp_iterations > 0
