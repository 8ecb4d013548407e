"""Scores against a constructed truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gepf.common.arrays import Array
from gepf.common.errors import InputError
from gepf.coordinator.results.evaluation import Truth, angle_error_deg, evaluate, read_truth
from gepf.coordinator.results.track import Track, read_track, write_track

DOFS = ("root_tx", "r_elbow_flexion", "r_shoulder_abduct")
JOINTS = ("pelvis", "right_wrist")
FRAMES = 10


def make_track(**changes: Any) -> Track:
    """A track of all zeros, two hypotheses of which the second is missing, but for `changes`."""
    unknown = np.full((FRAMES, len(JOINTS)), np.nan)
    fields: dict[str, Any] = {
        "frame": np.arange(FRAMES),
        "time_s": np.arange(FRAMES) / 30,
        "dof_names": DOFS,
        "pose": np.zeros((FRAMES, len(DOFS))),
        "joint_names": JOINTS,
        "joint_positions": np.zeros((FRAMES, len(JOINTS), 3)),
        **dict.fromkeys(("joint_deviation", "joint_off_probability", "joint_seen"), unknown),
        "angle_names": (),
        "angle": np.empty((FRAMES, 0)),
        "angle_deviation": np.empty((FRAMES, 0)),
        "hypothesis_pose": np.stack([np.zeros((FRAMES, 3)), np.full((FRAMES, 3), np.nan)], axis=1),
        "hypothesis_weight": np.tile([1.0, np.nan], (FRAMES, 1)),
        "status": np.full(FRAMES, "tracked", dtype="<U9"),
    }
    return Track(**fields | changes)


def make_truth(**changes: Any) -> Truth:
    """A truth of all zeros, but for `changes`."""
    track = make_track()
    whole = Truth(track.frame, JOINTS, track.joint_positions, DOFS, track.pose)
    return replace(whole, **changes)


def test_the_deviation_is_held_against_the_errors() -> None:
    """Errors of 3 and 7 cm where 4 cm are expected: half within one, all within two; lost frames are out."""
    joints = np.zeros((FRAMES, 2, 3))
    joints[:, 0, 0], joints[:, 1, 2] = 0.03, 0.07
    joints[3] = 9.0
    expected = np.full((FRAMES, 2), 0.04)
    expected[3] = np.nan
    score = evaluate(make_track(joint_positions=joints, joint_deviation=expected), make_truth())
    assert score.within_deviation == 0.5
    assert score.within_two_deviations == 1.0
    assert evaluate(make_track(), make_truth()).within_deviation is None


def test_angles_are_scored_in_degrees_by_name_and_without_translations() -> None:
    """The truth may have another order of names, and metres never count as angles."""
    pose = np.zeros((FRAMES, 3))
    pose[:, 0], pose[:, 1] = 5.0, np.deg2rad(10.0)
    truth = make_truth(
        dof_names=("r_shoulder_abduct", "l_elbow_flexion", "r_elbow_flexion", "root_tx"),
        pose=np.tile(np.deg2rad([0.0, 90.0, 4.0, 0.0]), (FRAMES, 1)),
    )
    score = evaluate(make_track(pose=pose), truth)
    assert score.mean_angle_error_deg_by_dof == pytest.approx(
        {"r_elbow_flexion": 6.0, "r_shoulder_abduct": 0.0}
    )
    assert score.mean_angle_error_deg == pytest.approx(3.0)


@given(angle=st.floats(-20, 20), truth=st.floats(-20, 20), turns=st.integers(-3, 3))
def test_an_angle_error_is_the_shorter_way_round(angle: float, truth: float, turns: int) -> None:
    """At most half a turn, symmetric, and the same for every number of whole turns."""
    error = angle_error_deg(np.array(angle), np.array(truth))
    assert 0.0 <= error <= 180.0
    assert error == pytest.approx(angle_error_deg(np.array(truth), np.array(angle)), abs=1e-9)
    assert error == pytest.approx(
        angle_error_deg(np.array(angle + 2 * np.pi * turns), np.array(truth)), abs=1e-6
    )
    assert np.cos(np.deg2rad(error)) == pytest.approx(np.cos(angle - truth), abs=1e-9)


def test_the_best_hypothesis_is_chosen_frame_by_frame() -> None:
    """The nearest over all angles, reported or not; padding is never chosen."""
    hypotheses = np.full((FRAMES, 3, 3), np.nan)
    hypotheses[:, 0] = np.deg2rad([0.0, 20.0, 20.0])
    hypotheses[::2, 1] = np.deg2rad([0.0, 2.0, 4.0])
    score = evaluate(make_track(hypothesis_pose=hypotheses), make_truth())
    assert score.best_hypothesis_angle_error_deg == pytest.approx((3.0 + 20.0) / 2)
    assert score.best_hypothesis_angle_error_deg_by_dof == pytest.approx(
        {"r_elbow_flexion": 11.0, "r_shoulder_abduct": 12.0}
    )


def test_joints_are_scored_in_centimetres_by_name() -> None:
    """Mean distance, and the share within ten centimetres; joints of one side alone do not count."""
    places = np.zeros((FRAMES, 3, 3))
    places[:, 1] = [0.0, 0.0, 9.0]
    places[:, 2] = [0.03, 0.04, 0.0]
    truth = make_truth(joint_names=("right_wrist", "left_wrist", "pelvis"), joint_positions=places)
    score = evaluate(make_track(), truth)
    assert score.mean_joint_error_cm == pytest.approx(2.5)
    places[:5, 0] = [0.2, 0.0, 0.0]
    score = evaluate(make_track(), truth)
    assert score.pck10 == pytest.approx(0.75)


def test_without_a_true_pose_only_joints_are_scored() -> None:
    """A motion-capture truth has positions, no angles; a perfect track has no error and is never lost."""
    score = evaluate(make_track(), make_truth(dof_names=(), pose=np.empty((FRAMES, 0))))
    assert score.mean_angle_error_deg is score.best_hypothesis_angle_error_deg is None
    assert score.mean_angle_error_deg_by_dof is score.best_hypothesis_angle_error_deg_by_dof is None
    assert (score.frames, score.mean_joint_error_cm, score.pck10) == (FRAMES, 0.0, 1.0)
    assert score.lost_from_frame is None
    assert evaluate(make_track(), make_truth()).best_hypothesis_angle_error_deg == 0.0


def test_angles_of_limbs_are_held_against_the_true_joints() -> None:
    """Mean and worst by name, the shorter way round; of joints that the truth has, where known."""
    arm = np.array([[0.0, 0.0, 2.0], [0.0, 0.3, 2.0], [0.0, 0.3, 1.75]])  # bent by 90 degrees
    angle = np.deg2rad(np.tile([[85.0, 20.0, 7.0]], (FRAMES, 1)))
    angle[0, 0], angle[1, 0] = np.deg2rad(90.0 - 360.0), np.deg2rad(60.0)
    angle[2] = np.nan
    names = ("right_elbow_flexion", "left_elbow_flexion", "trunk_flexion")
    truth = make_truth(
        joint_names=("right_shoulder", "right_elbow", "right_wrist", "pelvis"),
        joint_positions=np.tile(np.concatenate([arm, [[0.0, 0.0, 0.0]]]), (FRAMES, 1, 1)),
        dof_names=(),
        pose=np.empty((FRAMES, 0)),
    )
    score = evaluate(make_track(angle_names=names, angle=angle, angle_deviation=angle), truth)
    assert score.mean_angle_error_deg_by_angle == pytest.approx({names[0]: (0.0 + 30.0 + 7 * 5.0) / 9})
    assert score.worst_angle_error_deg_by_angle == pytest.approx({names[0]: 30.0})
    assert evaluate(make_track(), truth).mean_angle_error_deg_by_angle is None


def test_joints_that_slide_are_no_angles() -> None:
    """Neither they nor the root's place, of which the truth says so."""
    names = ("root_tx", "lift", "turn")
    truth = make_truth(joint_names=("a", "b"), dof_names=names, slides=names[:2])
    track = make_track(pose=np.full((FRAMES, 3), 0.5), dof_names=names)
    assert set(evaluate(track, truth).mean_angle_error_deg_by_dof or ()) == {"turn"}


def test_truth_that_is_not_known_does_not_count() -> None:
    """An unknown joint is NaN in the truth; the others are scored."""
    places = np.zeros((FRAMES, 2, 3))
    places[:, 0] = np.nan
    places[:, 1] = [0.02, 0.0, 0.0]
    score = evaluate(make_track(), make_truth(joint_positions=places))
    assert score.mean_joint_error_cm == pytest.approx(2.0)
    assert score.pck10 == 1.0


def test_only_frames_of_both_sides_count_and_are_matched_by_number() -> None:
    """A track of a part of the sequence is compared with that part of the truth."""
    places = np.zeros((FRAMES, 2, 3))
    places[:, :, 0] = 0.01 * np.arange(FRAMES)[:, None]
    track = make_track(frame=np.arange(FRAMES) + 7)
    score = evaluate(track, make_truth(joint_positions=places))
    assert score.frames == 3
    assert score.mean_joint_error_cm == pytest.approx(8.0)
    with pytest.raises(InputError, match=r"track \(frames 10 to 19\) and the truth \(frames 0 to 9\)"):
        evaluate(make_track(frame=np.arange(FRAMES) + 10), make_truth())


def off(frames: list[int], error: float) -> Array:
    """One error in some frames, none in the others."""
    return np.where(np.isin(np.arange(FRAMES), frames), error, 0.0)


@pytest.mark.parametrize(
    ("far", "from_frame"),
    [([7, 8, 9], 7), ([2, 3, 7, 8, 9], 7), ([2, 3, 4], None), ([9], 9), (list(range(FRAMES)), 0), ([], None)],
)
def test_lost_means_far_off_to_the_end(far: list[int], from_frame: int | None) -> None:
    """A track that comes back was not lost. Either of joints and angles is enough, the other being right."""
    places = np.zeros((FRAMES, 2, 3))
    places[:, :, 2] = off(far, 0.31)[:, None]
    pose = np.zeros((FRAMES, 3))
    pose[:, 1:] = off(far, np.deg2rad(31.0))[:, None]
    assert evaluate(make_track(joint_positions=places), make_truth()).lost_from_frame == from_frame
    assert evaluate(make_track(pose=pose), make_truth()).lost_from_frame == from_frame


def test_a_truth_with_nothing_in_common_is_refused() -> None:
    """Scores of nothing would look like scores."""
    truth = make_truth(dof_names=("root_tx",), pose=np.zeros((FRAMES, 1)), joint_names=("a", "b"))
    with pytest.raises(InputError, match="has no angle or joint of the track"):
        evaluate(make_track(), truth)


def write_truth(path: Path, **changes: Any) -> Path:
    """A truth file; `None` leaves a key out."""
    content: dict[str, Any] = {
        "joint_names": np.array(JOINTS),
        "joint_positions": np.zeros((FRAMES, 2, 3)),
        "dof_names": np.array(DOFS),
        "pose": np.zeros((FRAMES, 3)),
    } | changes
    np.savez(path, allow_pickle=True, **{key: value for key, value in content.items() if value is not None})
    return path


def test_a_truth_file_without_numbers_counts_from_zero(tmp_path: Path) -> None:
    """Frame numbers and the pose are optional; values that are not finite are unknown."""
    places = np.zeros((FRAMES, 2, 3))
    places[3, 1] = np.inf
    truth = read_truth(write_truth(tmp_path / "t.npz", joint_positions=places, dof_names=None, pose=None))
    assert truth.frame.tolist() == list(range(FRAMES))
    assert (truth.dof_names, truth.pose.shape) == ((), (FRAMES, 0))
    assert np.isnan(truth.joint_positions[3, 1]).all()
    assert read_truth(write_truth(tmp_path / "n.npz", frame=np.arange(FRAMES) + 4)).frame[0] == 4


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"joint_names": None}, "has no array 'joint_names'"),
        ({"pose": None}, "has no 'pose'"),
        ({"joint_positions": np.zeros((FRAMES, 3, 3))}, "'joint_positions' has shape"),
        ({"pose": np.zeros((FRAMES - 1, 3))}, "'pose' has shape"),
        ({"frame": np.arange(FRAMES) / 2}, "'frame' must be whole numbers"),
        ({"joint_names": np.array(["a", "a"])}, "distinct names"),
        ({"joint_positions": np.full((FRAMES, 2, 3), "x")}, "must be numbers"),
        ({"joint_positions": np.full((FRAMES, 2, 3), None)}, "damaged"),
    ],
)
def test_a_truth_file_that_makes_no_sense_is_refused(
    tmp_path: Path, changes: dict[str, Any], says: str
) -> None:
    """Each key is checked, and nothing is unpickled."""
    with pytest.raises(InputError, match=says):
        read_truth(write_truth(tmp_path / "truth.npz", **changes))


def test_a_damaged_or_missing_file_is_refused(tmp_path: Path) -> None:
    """Cut, altered, of another kind, or not there."""
    whole = write_truth(tmp_path / "truth.npz").read_bytes()
    path = tmp_path / "other.npz"
    for content in (whole[:100], whole[: len(whole) // 2], b"", b"text"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"other\.npz is damaged"):
            read_truth(path)
    np.save(tmp_path / "one.npy", np.zeros(3))
    with pytest.raises(InputError, match="single array"):
        read_truth(tmp_path / "one.npy")
    with pytest.raises(InputError, match="no such file"):
        read_truth(tmp_path / "nowhere.npz")
    with pytest.raises(InputError, match="damaged"):
        read_truth(tmp_path)


def test_a_track_is_read_from_a_runs_folder_only(tmp_path: Path) -> None:
    """A folder of something else, and poses that are not finite."""
    with pytest.raises(InputError, match=r"holds no track\.npz"):
        read_track(tmp_path)
    with (tmp_path / "track.npz").open("wb") as file:
        write_track(make_track(pose=np.full((FRAMES, 3), np.nan)), file)
    with pytest.raises(InputError, match="not finite"):
        read_track(tmp_path)


def test_a_body_without_angles_is_read_back(tmp_path: Path) -> None:
    """A body with only sliding joints has an empty list of names, which is valid."""
    with (tmp_path / "track.npz").open("wb") as file:
        write_track(make_track(), file)
    assert read_track(tmp_path).angle_names == ()
