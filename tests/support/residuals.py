"""The tracker's normalised residual of a pose."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.frame import SubjectFrame
from common.settings import RefineSettings
from coordinator.tracking.gating import gate_pose
from gepf.direct import DirectRefiner


def residual_of(
    model: BodyModel, pose: NDArray[np.float64], subject: SubjectFrame, settings: RefineSettings
) -> float:
    """The normalised residual of a pose (D,) that is not refined."""
    refiner, settings = DirectRefiner(), msgspec.structs.replace(settings, icp_iterations=0)
    found = refiner.submit(subject, model, pose[None], settings).result()
    return gate_pose(found.log_likelihood[0], found.residual[0], settings).residual
