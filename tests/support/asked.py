"""The content of a request, kernels defined by their answer, and artificial answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.arrays import Array
from common.body import BodyModel
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings
from coordinator.tracking.refiner import Pending, Refiner
from worker.service import Refine


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """The content of one request."""

    model: BodyModel
    poses: Array  # (N, D)
    settings: RefineSettings
    covariance: bool
    subject: SubjectFrame | None = None  # None in a worker, which has an observation

    def of(self, refiner: Refiner) -> Pending:
        """The same request to another refiner."""
        assert self.subject is not None
        of, given = (self.subject, self.model), (self.poses, self.settings)
        return refiner.submit(*of, *given, covariance=self.covariance)


def refining(answer: Callable[[Asked, Any], Refined]) -> Refine:
    """A worker's kernel that answers a request and an observation with this function."""

    def refine(
        model: BodyModel,
        seen: object,
        poses: Array,
        settings: RefineSettings,
        *,
        covariance: bool = False,
        velocity: Array | None = None,
    ) -> Refined:
        del velocity
        return answer(Asked(model, poses, settings, covariance), seen)

    return refine


def sure(poses: Array, deviation: float = 0.01) -> NDArray[np.float32]:
    """Roots of covariances of poses (N, D): this deviation in every direction."""
    dofs = poses.shape[1]
    root = deviation * np.eye(dofs, dtype=np.float32)[np.tri(dofs, dtype=np.bool_)]
    return np.tile(root, (len(poses), 1))


def as_bytes(refined: Refined) -> list[bytes]:
    """All results of each particle."""
    results = refined.poses, refined.log_likelihood, refined.residual, refined.covariance_roots
    columns = [column for column in results if column is not None]
    return [b"".join(column[n].tobytes() for column in columns) for n in range(len(refined.poses))]


def unmoved(poses: Array, *, covariance: bool) -> Refined:
    """Unchanged poses (N, D), all equally likely, with a residual of 1 cm, and a covariance on request."""
    count = len(poses)
    return Refined(poses, np.zeros(count), np.full(count, 0.01), sure(poses) if covariance else None)
