"""The port through which the tracker has particles refined: by a pool of workers or in this process."""

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
        """Wait for the particles after their descent, with likelihood and residual, in the order given.

        A deadline may leave some of them unanswered, but not all.
        """
        ...


class Refiner(Protocol):
    """Refines particles on the frame that was published last, one request at a time."""

    def publish(self, subject: SubjectFrame) -> None:
        """Make a frame known to the workers; all later calls of `submit` are about it."""
        ...

    def send_ahead(self, subject: SubjectFrame) -> None:
        """Let the workers have a frame that is to be published next; `submit` stays with the one before."""
        ...

    def submit(
        self,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        *,
        covariance: bool = False,
    ) -> Pending:
        """Begin to refine poses (N, D), and to tell how sure each of them is, if asked for.

        A request whose result was not taken by then is given up.
        """
        ...
