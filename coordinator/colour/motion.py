"""How far a person has moved since the last pose, by the keypoints of the trunk and the depth there.

At low rates people move farther between two frames than the surface around which they are segmented reaches.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.frame import Frame
from gepf.common.kinematics import pose_vertices
from gepf.coordinator.colour.keypoints import TRUNK, trunk_pixels
from gepf.coordinator.colour.matching import ExpectedBody, Keypoints
from gepf.coordinator.settings import ColourSettings


def trunk_step(
    body: ExpectedBody, keypoints: Keypoints, frame: Frame, max_motion_m: float, settings: ColourSettings
) -> Array | None:
    """The motion (3,) of a person from an expected body to its keypoints, metres, in the frame of the rig.

    None if there are no keypoints or no depth at the trunk, or if the motion is longer than `max_motion_m`:
    then the keypoints are somebody else's.
    """
    middle_m, front = settings.trunk_middle_m, settings.hand_share
    for view in frame.views:
        if view.camera not in keypoints:
            continue
        seen, depth_m, camera = keypoints[view.camera][TRUNK], view.metres(), view.intrinsics
        columns, rows = np.rint(trunk_pixels(keypoints[view.camera])).astype(int).T
        inside = (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
        surface = depth_m[rows[inside], columns[inside]]
        surface = surface[surface > 0.0]
        joints = view.to_camera(body.keypoints)[TRUNK]
        vertices = view.to_camera(pose_vertices(body.model, body.pose[None])[0])
        middle, ahead = joints.mean(axis=0), vertices[vertices[:, 2] > 0.0]
        aside = middle[2] * np.linalg.norm(ahead[:, :2] / ahead[:, 2:] - middle[:2] / middle[2], axis=1)
        if 2 * len(surface) < len(columns) or not (aside < middle_m).any() or middle[2] <= 0.0:
            continue
        weights = seen[:, 2] / seen[:, 2].sum()
        before, (column, row) = weights @ joints, weights @ seen[:, :2]
        z = float(np.median(surface)) + before[2] - float(np.quantile(ahead[aside < middle_m, 2], front))
        after = np.array([(column - camera.cx) / camera.fx * z, (row - camera.cy) / camera.fy * z, z])
        if np.linalg.norm(after - before) <= max_motion_m:
            return np.asarray(view.T_rig_camera[:3, :3] @ (after - before))
    return None
