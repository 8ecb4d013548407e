"""The skeletons of UTD-MHAD as joints to compare with."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.io
from numpy.typing import NDArray

JOINTS = (
    "head", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle",
)  # fmt: skip
"""The joints that count."""

ACTIONS = (
    "swipe left", "swipe right", "wave", "clap", "throw", "cross arms", "basketball shoot", "draw X",
    "draw circle (cw)", "draw circle (ccw)", "draw triangle", "bowling", "boxing", "baseball swing",
    "tennis swing", "arm curl", "tennis serve", "push", "knock", "catch", "pick up and throw", "jog in place",
    "walk in place", "sit to stand", "stand to sit", "lunge", "squat",
)  # fmt: skip
"""What people do in the actions, which are numbered from 1."""

SKELETON_LEAD = 2  # frames: depth frame t shows what skeleton frame t - 2 shows

_ROWS = (
    "head", "shoulder_center", "spine", "hip_center",
    "left_shoulder", "left_elbow", "left_wrist", "left_hand",
    "right_shoulder", "right_elbow", "right_wrist", "right_hand",
    "left_hip", "left_knee", "left_ankle", "left_foot",
    "right_hip", "right_knee", "right_ankle", "right_foot",
)  # fmt: skip
_OTHER_SIDE = {"right": "left", "left": "right"}


def read_skeleton(path: Path) -> NDArray[np.float64]:
    """Joints (T, 13, 3) in the camera frame, metres, in the order of JOINTS; left and right as gepf has them.

    The data set's pictures are mirrored, so what its skeleton calls left is the right of the picture.
    """
    skeleton = scipy.io.loadmat(path)["d_skel"]  # (20, 3, T)
    rows = [_ROWS.index(_mirrored(name)) for name in JOINTS]
    joints: NDArray[np.float64] = np.moveaxis(skeleton[rows], 2, 0) * np.array([1.0, -1.0, 1.0])  # y down
    return joints


def _mirrored(name: str) -> str:
    side, _, rest = name.partition("_")
    return f"{_OTHER_SIDE[side]}_{rest}" if side in _OTHER_SIDE else name


def paired(joints: NDArray[np.float64], skeleton: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Joints (F, 13, 3) of depth frames from SKELETON_LEAD on, and of the skeleton at the same moments."""
    count = min(len(joints), len(skeleton) + SKELETON_LEAD) - SKELETON_LEAD
    return joints[SKELETON_LEAD : SKELETON_LEAD + count], skeleton[:count]


def distances(
    joints: NDArray[np.float64], reference: NDArray[np.float64], remove_offset: bool
) -> NDArray[np.float64]:
    """Distances (F, J) in metres, if asked after removing each joint's constant median offset."""
    apart = joints - reference
    if remove_offset:
        apart = apart - np.median(apart, axis=0)
    found: NDArray[np.float64] = np.linalg.norm(apart, axis=-1)
    return found
