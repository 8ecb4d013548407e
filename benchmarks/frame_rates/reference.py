"""The SDK's joints of a recording, and which of them the depth contradicts.

The reference is a vendor's estimate and wrong in many of the worst frames. A joint lies inside the body, so
at its pixel the surface is before it, by no more than a trunk is thick; and its bone is as long as it is in
the other frames. Where the picture says otherwise the joint is contradicted.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from benchmarks.utd import JOINTS, SKELETON_LEAD, read_skeleton
from common.frame import DepthFrame

Array = NDArray[np.float64]

MOST_BEFORE = 0.28  # metres that the surface may be nearer than a joint
MOST_BEHIND = 0.08  # and farther
BESIDE = 4.0  # pixels that a joint may lie outside the silhouette
BONE_CHANGE = 0.2  # of its median length

_UPPER = {
    "right_elbow": "right_shoulder", "right_wrist": "right_elbow",
    "left_elbow": "left_shoulder", "left_wrist": "left_elbow",
    "right_knee": "right_hip", "right_ankle": "right_knee",
    "left_knee": "left_hip", "left_ankle": "left_knee",
}  # fmt: skip
"""The joint at the other end of a joint's bone."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Joints (T, 13, 3) of the depth frames from SKELETON_LEAD on, camera frame, metres; which hold."""

    joints: Array
    holds: NDArray[np.bool_]  # (T, 13)

    def at(self, frames: NDArray[np.int64]) -> tuple[NDArray[np.bool_], Array, NDArray[np.bool_]]:
        """Which of the depth frames (F,) have a reference, its joints (K, 13, 3), and which hold (K, 13)."""
        place = frames - SKELETON_LEAD
        there = (place >= 0) & (place < len(self.joints))
        return there, self.joints[place[there]], self.holds[place[there]]


def read_reference(path: Path, depth: list[DepthFrame]) -> Reference:
    """The reference of a recording whose frames are all given, in their order from number 0 on."""
    joints = read_skeleton(path)
    joints = joints[: len(depth) - SKELETON_LEAD]
    before_it = [fits_depth(joints[t], depth[t + SKELETON_LEAD]) for t in range(len(joints))]
    return Reference(joints, np.array(before_it) & fits_bones(joints))


def fits_depth(joints: Array, frame: DepthFrame) -> NDArray[np.bool_]:
    """Which joints (J, 3) lie where the surface that is seen at their pixel lets them."""
    camera, depth = frame.intrinsics, frame.metres().astype(np.float64)
    away, nearest = distance_transform_edt(depth <= 0.0, return_indices=True)
    column = np.rint(camera.cx + camera.fx * joints[:, 0] / joints[:, 2]).astype(int)
    row = np.rint(camera.cy + camera.fy * joints[:, 1] / joints[:, 2]).astype(int)
    inside = (row >= 0) & (row < camera.height) & (column >= 0) & (column < camera.width)
    row, column = np.where(inside, row, 0), np.where(inside, column, 0)
    surface = depth[nearest[0][row, column], nearest[1][row, column]]
    behind_surface = joints[:, 2] - surface
    near = inside & (away[row, column] <= BESIDE)
    fits: NDArray[np.bool_] = near & (behind_surface <= MOST_BEFORE) & (behind_surface >= -MOST_BEHIND)
    return fits


def fits_bones(joints: Array) -> NDArray[np.bool_]:
    """Which joints (T, J) are as far from the upper end of their bone as usual."""
    fits = np.ones(joints.shape[:2], dtype=bool)
    for name, upper in _UPPER.items():
        lower = JOINTS.index(name)
        length = np.linalg.norm(joints[:, lower] - joints[:, JOINTS.index(upper)], axis=-1)
        usual = np.median(length)
        fits[:, lower] = np.abs(length - usual) <= BONE_CHANGE * usual
    return fits
