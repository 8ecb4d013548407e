"""Axes that are level where a camera is not."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def level_from_camera(up: Array | None) -> Array:
    """The rotation (3, 3) into axes that are the camera's, had it been held level: x right, y down, z ahead.

    Args:
        up: Unit vector (3,) away from the ground, camera frame; None where it is not known: no rotation.
    """
    if up is None:
        return np.eye(3)
    down = -np.asarray(up, dtype=np.float64) / np.linalg.norm(up)
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    if np.linalg.norm(ahead) < STRAIGHT_DOWN:  # then what is at the picture's top is ahead
        ahead = np.array([0.0, -1.0, 0.0]) + down[1] * down
    ahead /= np.linalg.norm(ahead)
    return np.stack([np.cross(down, ahead), down, ahead])


STRAIGHT_DOWN = 0.1  # sine of the angle between the line of sight and the vertical
