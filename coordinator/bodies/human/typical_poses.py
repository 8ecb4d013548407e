"""Poses in which people are searched for: the medoids of recorded poses, combined with ranges of joints.

`python -m benchmarks.pose_library` chose them, with the measure of distance that detection uses.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel

POSES_FILE = Path(__file__).with_name("poses.npz")
UNIT_RAD = 2e-4  # the angles in the file are integer multiples of it


def people_poses(model: BodyModel, count: int | None = None) -> Array:
    """The first `count` poses (N, D) of the file, or all, with the root at the origin; fewer are coarser.

    They are seen from all sides, and from slightly above or below.
    """
    with np.load(POSES_FILE) as file:
        names, units = file["dof_names"].tolist(), file["poses"][:count]
    poses = np.zeros((len(units), len(model.dof_names)))
    for name, column in zip(names, units.T, strict=True):
        if name in model.dof_names:
            poses[:, model.dof(name)] = UNIT_RAD * column
    return np.asarray(np.clip(poses, model.limits[:, 0], model.limits[:, 1]))
