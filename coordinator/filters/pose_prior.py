"""The Gaussian prior of the pose that a request for refinement brings along.

Joints are near rest, the base is anywhere, and the shape is what earlier frames showed. Shape is constant,
but errors of successive frames are not independent, as they follow from pose and clothes. All frames within
`error_time_s` together count as one. So the precision P of the earlier frames is divided by the share k of a
frame, which makes the refinement the recursive estimate of a constant from frames with the share k of their
information I. With the covariance S of the shape by the refinement, k I = k S^-1 - P. The precision after the
frame is P + c k I. The factor c corrects that the Gauss-Newton matrix overstates the information: it holds
correspondences fixed, which slide along the surface.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, SHAPE, BodyModel
from gepf.common.refinement import PosePrior
from gepf.common.settings import RefineSettings
from gepf.coordinator.settings import ShapeSettings


def pose_prior(
    model: BodyModel, settings: RefineSettings, shapes: Array | None = None, precision: Array | None = None
) -> PosePrior | None:
    """The prior for poses with these shapes (N, S) or (S,), which have a precision (S, S).

    Without a precision it is that of the population around each shape. None without any prior. With soft
    correspondences there is none of joints: it was not measured with them.
    """
    count, dofs = model.shape_count, len(model.dof_names)
    resting = not settings.is_soft and settings.pose_deviation > 0.0
    if not (resting or count):
        return None
    free = np.isin(model.dof_names, ROOT_DOFS) | (model.kinds == SHAPE) | (not resting)
    diagonal = np.where(free, 0.0, (max(settings.pose_deviation, 1e-9) * model.rest_spreads) ** -2.0)
    if not count:
        return PosePrior(np.zeros(dofs), diagonal)
    assert shapes is not None
    mean, matrix = np.zeros((*shapes.shape[:-1], dofs)), np.diag(diagonal)
    mean[..., :count] = shapes
    matrix[:count, :count] = population_precision(model) if precision is None else precision
    return PosePrior(mean, matrix)


def population_precision(model: BodyModel) -> Array:
    """Precision (S, S) of the shape around a detected one."""
    precision: Array = np.diag(model.rest_spreads[: model.shape_count] ** -2.0)
    return precision


def frame_share(interval: float, error_time_s: float) -> float:
    """The share of its information by which a frame after so many seconds counts."""
    return min(1.0, interval / error_time_s)


def updated_precision(precision: Array, covariance: Array, interval: float, settings: ShapeSettings) -> Array:
    """Precision (S, S) of the shape after a frame, in whose refinement it had this covariance (S, S)."""
    gain = frame_share(interval, settings.error_time_s) * np.linalg.inv(covariance) - precision
    after: Array = precision + settings.curvature_share * gain
    return 0.5 * (after + after.T)
