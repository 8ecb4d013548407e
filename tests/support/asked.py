"""What one request asks for, and a worker's kernel of which only the answer has to be said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.refinement import Refined
from common.settings import RefineSettings
from coordinator.tracking.refiner import Pending, Refiner
from worker.service import Refine


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """What one request asks for."""

    model: BodyModel
    poses: NDArray[np.float64]  # (N, D)
    settings: RefineSettings
    covariance: bool

    def of(self, refiner: Refiner) -> Pending:
        """The same request to another refiner."""
        return refiner.submit(self.model, self.poses, self.settings, covariance=self.covariance)


def refining(answer: Callable[[Asked, Any], Refined]) -> Refine[Any]:
    """A worker's kernel that gives this answer to what is asked, and to what it has observed."""

    def refine(
        model: BodyModel,
        seen: object,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> Refined:
        return answer(Asked(model, poses, settings, covariance), seen)

    return refine
