"""A person before several cameras, rendered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.frame import Frame
from gepf.common.kinematics.rotations import euler_matrix
from tests.support.people import frame_of, rendered

MIDDLE = np.array([0.1, 0.1, 2.7])  # where the person is


def around(yaw_deg: float) -> Array:
    """T_rig_camera (4, 4) of a camera that looks at the person, turned about them from the rig's own."""
    placed = np.eye(4)
    placed[:3, :3] = euler_matrix(np.array([0.0, -np.radians(yaw_deg), 0.0]))
    placed[:3, 3] = MIDDLE - placed[:3, :3] @ MIDDLE
    return placed


def seen_from(model: BodyModel, poses: Sequence[Array], places: Mapping[str, Array]) -> Frame:
    """A frame of cameras at places by name, each with the body in its own pose (D,)."""
    views = []
    for pose, (name, placed) in zip(poses, places.items(), strict=True):
        (depth,) = rendered(model, pose[None], placed=placed)
        views.append(replace(frame_of(0, depth).views[0], camera=name, T_rig_camera=placed))
    return Frame.of(*views)
