"""Keypoints of a body in a pose."""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.kinematics.chain import link_transforms, shaped


def keypoint_positions(model: BodyModel, poses: Array) -> Array:
    """Keypoints (N, K, 3) in the camera frame, for poses (N, D)."""
    carried, shares = model.shape_vertices[:, model.keypoint_vertices], model.keypoint_shares
    places = shaped(model.keypoint_points, np.einsum("kw,skwa->ska", shares, carried), poses)
    t = link_transforms(model, poses).take(model.keypoint_links, axis=1)
    x, y, z = np.moveaxis(places, -1, 0)[..., None]
    return np.asarray(t[..., 0] * x + t[..., 1] * y + t[..., 2] * z + t[..., 3])
