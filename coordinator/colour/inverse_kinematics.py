"""Poses from keypoints: the nearest to a given pose that agrees with them, and with the depth under them.

Gauss-Newton over the pixels of the keypoints, the depth of those that are visible, and a Gaussian prior about
the given pose, all but the prior with a robust kernel (Geman-McClure).
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.camera import project
from gepf.common.frame import DepthFrame
from gepf.common.kinematics import difference, keypoint_positions, retract, within_limits
from gepf.common.refinement import KEYPOINT_OUTLIER

STEPS = 10
STEP = 1e-4  # radians and metres, of finite differences
BEHIND_M = 0.07  # from the surface to a keypoint
DEPTH_DEVIATION_M = 0.08  # of that, and of depth under a keypoint that is off
WINDOW_PX = 2  # to each side of a keypoint, in which depth is looked for
NEAREST_M = 0.2
TURN_DEVIATION = np.radians(40.0)  # of joint angles around the given pose
PLACE_DEVIATION_M = 1.0  # of the root, which keypoints determine


def fit_keypoints(model: BodyModel, start: Array, keypoints: Array, view: DepthFrame) -> Array:
    """The pose (D,) that agrees with keypoints (17, 3) of a camera's image, near a start (D,)."""
    pose, seen = start.copy(), keypoints[:, 2] > 0.0
    depth, measured = depth_under(keypoints, view)
    known = measured & seen
    prior = prior_precision(model)
    for _ in range(STEPS):
        around = retract(model, np.tile(pose, (len(pose), 1)), STEP * np.eye(len(pose)))
        places = view.to_camera(keypoint_positions(model, np.concatenate([pose[None], around])))
        if np.any(places[:, :, 2] < NEAREST_M):
            break
        pixels = project(places, view.intrinsics)
        off = np.concatenate(
            [
                (pixels - keypoints[:, :2]) * np.sqrt(keypoints[:, 2])[:, None],
                ((places[:, :, 2] - depth) / DEPTH_DEVIATION_M * known)[:, :, None],
            ],
            axis=2,
        )  # (1 + D, 17, 3) deviations
        squared = np.stack([np.sum(off[0, :, :2] ** 2, axis=1), off[0, :, 2] ** 2])
        weight = (KEYPOINT_OUTLIER**2 / (KEYPOINT_OUTLIER**2 + squared)) ** 2
        weights = np.stack([weight[0], weight[0], weight[1]], axis=1).ravel()
        jacobian = ((off[1:] - off[0]) / STEP).reshape(len(pose), -1)
        away = difference(model, start[None], pose[None])[0]
        gradient = jacobian @ (weights * off[0].ravel()) + prior * away
        gram = (jacobian * weights) @ jacobian.T + np.diag(prior)
        step = -np.linalg.solve(gram, gradient)
        step *= min(1.0, 0.5 / float(np.abs(step).max(initial=1e-9)))
        pose = within_limits(model, retract(model, pose[None], step[None]))[0]
    return pose


def depth_under(keypoints: Array, view: DepthFrame) -> tuple[Array, Mask]:
    """The depth (17,) of keypoints by the nearest measured pixels around them, and where it is known."""
    depth, found = view.metres(), np.zeros(len(keypoints))
    for k, (column, row) in enumerate(np.rint(keypoints[:, :2]).astype(int)):
        top, left = max(0, row - WINDOW_PX), max(0, column - WINDOW_PX)
        window = depth[top : max(0, row + WINDOW_PX + 1), left : max(0, column + WINDOW_PX + 1)]
        near = window[window > 0.0]
        found[k] = np.median(near) if near.size else 0.0
    return found + BEHIND_M, found > 0.0


def prior_precision(model: BodyModel) -> Array:
    """The inverse variance (D,) of the pose around the start; shape coefficients do not move."""
    free = np.isin(model.dof_names, ROOT_DOFS)
    turning = model.kinds == ROTATION
    deviation = np.where(free, np.where(turning, np.pi, PLACE_DEVIATION_M), TURN_DEVIATION)
    return np.where(model.moves, deviation**-2.0, 1e12)
