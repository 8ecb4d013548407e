"""The Gaussian prior of the pose that a request for refinement brings along."""

from __future__ import annotations

import numpy as np

from gepf.common.body import ROOT_DOFS, BodyModel
from gepf.common.refinement import PosePrior
from gepf.common.settings import RefineSettings


def rest_prior(model: BodyModel, settings: RefineSettings) -> PosePrior | None:
    """Joints are near rest, the base is anywhere. None with soft correspondences: not measured with them."""
    if settings.is_soft or settings.pose_deviation == 0.0:
        return None
    deviations = settings.pose_deviation * model.rest_spreads
    precision = np.where(np.isin(model.dof_names, ROOT_DOFS), 0.0, deviations**-2.0)
    return PosePrior(np.zeros(len(precision)), precision)
