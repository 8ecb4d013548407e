"""The interface for the refinement of particles, by a pool of workers or in this process."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.refinement import Refined
from common.settings import RefineSettings


class Pending(Protocol):
    """Particles that are being refined."""

    def result(self) -> Refined:
        """Wait for the refined particles, with likelihood and residual, in the order of submission.

        With a deadline some of them may be missing, but not all.
        """
        ...


class Refiner(Protocol):
    """Refines particles on the frame that was published last, one request at a time."""

    def publish(self, subject: SubjectFrame) -> None:
        """Send a frame to the workers; later calls of `submit` refer to it."""
        ...

    def send_ahead(self, subject: SubjectFrame) -> None:
        """Send the frame that will be published next; `submit` still refers to the frame before."""
        ...

    def submit(
        self,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> Pending:
        """Start to refine poses (N, D), and to estimate the covariance of each if requested.

        A previous request whose result was not taken is cancelled.
        """
        ...
