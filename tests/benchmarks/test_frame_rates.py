"""The benchmark of slow cameras: pairing by frame number, and which of the reference's joints count."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.frame_rates.picture import points_at
from benchmarks.frame_rates.reference import (
    MOST_BEFORE,
    MOST_BEHIND,
    Reference,
    fits_bones,
    fits_depth,
)
from benchmarks.frame_rates.rows import choose_rows
from benchmarks.frame_rates.scores import Marks, RowScore, mark
from benchmarks.frame_rates.trials import hold_against
from benchmarks.utd import JOINTS, SKELETON_LEAD
from common.camera import Intrinsics
from common.errors import InputError
from common.frame import DepthFrame

CAMERA = Intrinsics(40, 30, 30.0, 30.0, 20.0, 15.0)


def wall(depth_m: float) -> DepthFrame:
    """A surface at this depth in the picture's left half, and nothing in its right half."""
    depth = np.zeros((30, 40), dtype=np.uint16)
    depth[:, :20] = round(1000 * depth_m)
    return DepthFrame(0, 0.0, depth, 1000.0, CAMERA)


def test_thinned_frames_are_paired_by_their_number() -> None:
    """Where every third frame is tracked, an estimate meets the skeleton of its own moment."""
    joints = np.arange(10.0)[:, None, None] * np.ones((10, 13, 3))
    reference = Reference(joints, np.ones((10, 13), dtype=bool))
    numbers = np.arange(0, 12, 3)
    estimated = (numbers - SKELETON_LEAD)[:, None, None] * np.ones((4, 13, 3))
    compared = hold_against(reference, numbers, estimated, 1.0)
    assert compared.raw.shape == (3, 13)  # frame 0 comes before the skeleton begins
    assert np.all(compared.raw == 0.0)


@pytest.mark.parametrize(
    ("behind", "fits"),
    [(0.1, True), (MOST_BEFORE + 0.02, False), (-MOST_BEHIND + 0.02, True), (-MOST_BEHIND - 0.02, False)],
)
def test_a_joint_lies_behind_the_surface_but_not_far(behind: float, fits: bool) -> None:
    """A joint before the surface at its pixel, or farther behind it than a body is thick, is contradicted."""
    joint = np.array([[-0.3, 0.0, 2.0 + behind]])
    assert fits_depth(joint, wall(2.0)).tolist() == [fits]


def test_a_joint_beside_the_body_is_contradicted() -> None:
    """Where the camera saw nothing for several pixels around there is no body for a joint to be in."""
    assert fits_depth(np.array([[0.8, 0.0, 2.1]]), wall(2.0)).tolist() == [False]


def test_a_bone_of_unusual_length_contradicts_its_lower_joint() -> None:
    """A wrist that is half a forearm too far away in one frame counts in all frames but that one."""
    joints = np.random.default_rng(0).random((5, 13, 3))
    joints[:] = joints[0]
    wrist, elbow = JOINTS.index("left_wrist"), JOINTS.index("left_elbow")
    joints[3, wrist] = joints[3, elbow] + 1.5 * (joints[3, wrist] - joints[3, elbow])
    fits = fits_bones(joints)
    assert not fits[3, wrist]
    assert fits.sum() == fits.size - 1


def test_marks_count_only_what_holds() -> None:
    """A joint 50 cm off lowers the share of all joints, and not that of those whose reference holds."""
    reference = Reference(np.zeros((4, 13, 3)), np.ones((4, 13), dtype=bool))
    reference.holds[1, 0] = False
    estimated = np.zeros((4, 13, 3))
    estimated[1, 0] = [0.5, 0.0, 0.0]
    compared = hold_against(reference, np.arange(4) + SKELETON_LEAD, estimated, 0.0)
    assert mark([compared], held=False).raw_percent < 100.0
    assert mark([compared], held=True).raw_percent == 100.0


def test_an_unknown_row_is_named() -> None:
    """Who asks for a row that is not there learns which there are."""
    with pytest.raises(InputError, match="never moves"):
        choose_rows(["sometimes moves"])


def test_the_picture_has_a_line_for_each_frame_rate() -> None:
    """By the number of particles; what is no number of particles is left out."""

    def score(row: str, rate: float, percent: float) -> RowScore:
        marks = Marks(percent, 5.0, percent, 3.0)
        return RowScore(row, rate, 10, marks, marks, 1.0, [percent], 10.0, [])

    scores = [
        score("100 particles", 10.0, 96.0), score("1 particle", 10.0, 93.0), score("gradient", 10.0, 92.0),
        score("1 particle", 30.0, 95.0),
    ]  # fmt: skip
    assert points_at(10.0, scores) == [(1, 93.0), (100, 96.0)]
    assert points_at(30.0, scores) == [(1, 95.0)]
