"""The deviation of the joints of a robot or object of known measures, by the covariance of its pose.

The likelihood counts all points as one with an error of 1 cm, because the shape of people is not known. The
points of a known body are worth more.
"""

from __future__ import annotations

import numpy as np

from common.arrays import Array
from common.body import BodyModel
from common.kinematics import joint_positions, retract
from coordinator.filters.motion import precisions

INFORMATION = 44.0
"""Fitted to rendered robots and objects with a Kinect's noise."""


def deviations(model: BodyModel, pose: Array, covariance: Array) -> Array:
    """Expected distance (J,) from the true joints of a pose (D,), one standard deviation, metres.

    `covariance` (D, D) is that of the refinement, with the weak prior, which is not worth more.
    """
    weak = np.diag(precisions(model)[0])
    scaled = np.linalg.inv(weak + INFORMATION * (np.linalg.inv(covariance) - weak))
    step = 1e-5  # of differences, metres or radians
    steps = step * np.concatenate([np.eye(len(pose)), -np.eye(len(pose))])
    ahead, behind = np.split(joint_positions(model, retract(model, np.tile(pose, (len(steps), 1)), steps)), 2)
    jacobian = (ahead - behind) / (2.0 * step)
    squares: Array = np.einsum("djx,de,ejx->j", jacobian, scaled, jacobian)
    return np.sqrt(squares)
