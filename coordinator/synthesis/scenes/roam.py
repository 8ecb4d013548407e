"""Any body that moves all its joints at random, smoothly and within their limits, in front of a Kinect.

The base stands still, as that of a robot does; a body without joints is turned and carried about.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from common.body import ROOT_DOFS, ROTATION, BodyModel
from common.camera import Intrinsics
from common.errors import InputError
from common.kinematics import pose_vertices
from coordinator.synthesis.scenes.scene import Scene
from coordinator.synthesis.view_fitting import fit_in_view

Array = NDArray[np.float64]

FRAMES, FPS = 150, 30.0
CAMERA = Intrinsics(640, 480, 575.0, 575.0, 319.5, 239.5)
KEY_EVERY = 30  # frames
WIDEST, SLIDE_M = np.radians(40.0), 0.15  # to either side, where limits are wider
WITHIN = 0.4  # of the range between limits, to either side of its middle
STAND = {"root_rx": 0.2, "root_ry": 0.5}  # seen from above and from the side
CARRIED_M, TURNED = 0.08, np.radians(35.0)
FARTHEST_M = 6.0


def roam(model: BodyModel, seed: int = 0, frames: int = FRAMES) -> Scene:
    """A scene of a body; the same seed moves it in the same way. Tracking starts from the truth.

    Raises InputError for a body that is too large to be seen whole.
    """
    rng = np.random.default_rng([seed, 1])
    middle, reach = swing(model)
    keys = rng.uniform(-1.0, 1.0, (frames // KEY_EVERY + 2, len(middle))) * reach + middle
    poses = np.asarray(PchipInterpolator(KEY_EVERY * np.arange(len(keys)), keys)(np.arange(frames)))
    for name, value in STAND.items():
        poses[:, model.dof(name)] += value
    poses[:, :3] += place_in_view(model, poses)
    return Scene(model, CAMERA, FPS, poses, poses[0].copy())


def swing(model: BodyModel) -> tuple[Array, Array]:
    """Middle and amplitude (D,) of each degree of freedom's motion."""
    rotates = model.kinds == ROTATION
    root = np.array([name in ROOT_DOFS for name in model.dof_names])
    if root.all():
        return np.zeros(len(root)), np.where(rotates, TURNED, CARRIED_M)
    bounded = np.all(np.isfinite(model.limits), axis=1, keepdims=True)
    low, high = np.where(bounded, model.limits, 0.0).T
    reach = np.where(rotates, WIDEST, SLIDE_M)
    reach = np.where(bounded[:, 0], np.minimum(reach, WITHIN * (high - low)), reach)
    return 0.5 * (low + high), np.where(root, 0.0, reach)


def place_in_view(model: BodyModel, poses: Array) -> Array:
    """Shift (3,) that brings all poses into the middle of the image."""
    seen = pose_vertices(model, poses[:: max(1, len(poses) // 20)]).reshape(-1, 3)
    shift = fit_in_view(seen, CAMERA)
    if seen[:, 2].max() + shift[2] > FARTHEST_M:
        size = np.ptp(seen, axis=0).max()
        raise InputError(f"{model.name} is {size:.1f} m large and would be too far away; give a smaller body")
    return shift
