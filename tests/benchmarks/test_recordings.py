"""The references of benchmarks: skeletons of the data set, and which of their joints are valid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from benchmarks.recordings import JOINTS, Recording, fits_bones, fits_depth, read_reference, read_skeleton
from gepf.common.camera import Intrinsics
from gepf.common.frame import Frame, View

CAMERA = Intrinsics(40, 30, 30.0, 30.0, 20.0, 15.0)
LEFT_WRIST_ROW, RIGHT_KNEE_ROW = 6, 17  # of the data set's skeleton


def wall(depth_m: float) -> Frame:
    """A surface at this depth in the left half of the image, and no depth in the right half."""
    depth = np.zeros((30, 40), dtype=np.uint16)
    depth[:, :20] = round(1000 * depth_m)
    return Frame.of(View(0, 0.0, depth, 1000.0, CAMERA))


def write_skeleton(path: Path, skeleton: np.ndarray) -> Path:
    """Write a file like those of the data set, with a skeleton (20, 3, T)."""
    scipy.io.savemat(path, {"d_skel": skeleton})
    return path


def test_left_and_right_of_the_skeleton_change_places(tmp_path: Path) -> None:
    """The images are mirrored: the SDK's left wrist is our right one; its y points up, ours down."""
    skeleton = np.zeros((20, 3, 1))
    skeleton[LEFT_WRIST_ROW] = [[0.1], [0.2], [2.5]]
    skeleton[RIGHT_KNEE_ROW] = [[-0.3], [-0.4], [2.6]]
    joints = read_skeleton(write_skeleton(tmp_path / "skeleton.mat", skeleton))
    assert joints[0, JOINTS.index("right_wrist")].tolist() == [0.1, -0.2, 2.5]
    assert joints[0, JOINTS.index("left_knee")].tolist() == [-0.3, 0.4, 2.6]


def test_depth_frames_meet_the_skeleton_of_two_frames_before(tmp_path: Path) -> None:
    """For depth shorter and longer than the skeleton."""
    skeleton = np.broadcast_to(np.arange(1.0, 11.0), (20, 3, 10))
    path = write_skeleton(tmp_path / "skeleton.mat", skeleton)
    for frames, last in ((8, 7), (12, 11), (20, 11)):
        reference = read_reference(Recording("a1_s1", path, path, 1, 1), [wall(2.0)] * frames)
        assert reference.frame.tolist() == list(range(2, last + 1))
        assert np.array_equal(reference.joints[:, 0, 0], reference.frame - 1.0)


@pytest.mark.parametrize(
    ("x", "z", "fits"),
    [(-0.3, 2.1, True), (-0.3, 2.5, False), (-0.3, 1.98, True), (-0.3, 1.7, False), (0.8, 2.1, False)],
)
def test_a_joint_lies_behind_the_surface_but_not_far(x: float, z: float, fits: bool) -> None:
    """A joint in front of the surface, far behind it, or beside it by several pixels is not valid."""
    assert fits_depth(np.array([[x, 0.0, z]]), wall(2.0)).tolist() == [fits]


def test_a_bone_of_unusual_length_contradicts_its_lower_joint() -> None:
    """A wrist that is half a forearm too far away in one frame is invalid in that frame only."""
    joints = np.random.default_rng(0).random((5, 13, 3))
    joints[:] = joints[0]
    wrist, elbow = JOINTS.index("left_wrist"), JOINTS.index("left_elbow")
    joints[3, wrist] = joints[3, elbow] + 1.5 * (joints[3, wrist] - joints[3, elbow])
    fits = fits_bones(joints)
    assert not fits[3, wrist]
    assert fits.sum() == fits.size - 1
