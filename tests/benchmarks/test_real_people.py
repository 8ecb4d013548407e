"""The scoring of real people, on joints that are known by construction; on the data where they are there."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray

from benchmarks.choices import settings_with
from benchmarks.command_line import DATA
from benchmarks.comparison import Comparison, compare, compare_people, compare_skinned
from benchmarks.forks import Crash, run_forked
from benchmarks.real_people.__main__ import main
from benchmarks.real_people.report import Results, divide, report
from benchmarks.scores import accuracy, score, score_joints
from benchmarks.sequences import Recording, choose, find_recordings
from benchmarks.tracking import Tracked
from benchmarks.utd import JOINTS, SKELETON_LEAD, distances, paired, read_skeleton
from common.errors import InputError
from common.settings import Settings, preset

SDK_JOINTS = (
    "head", "shoulder_center", "spine", "hip_center",
    "left_shoulder", "left_elbow", "left_wrist", "left_hand",
    "right_shoulder", "right_elbow", "right_wrist", "right_hand",
    "left_hip", "left_knee", "left_ankle", "left_foot",
    "right_hip", "right_knee", "right_ankle", "right_foot",
)  # fmt: skip
FRAMES = 30
Array = NDArray[np.float64]


def write_skeleton(path: Path, skeleton: Array) -> Path:
    """A file like the data set's, of a skeleton (20, 3, T)."""
    scipy.io.savemat(path, {"d_skel": skeleton})
    return path


def random_joints(frames: int = FRAMES, joints: int = len(JOINTS)) -> Array:
    """Joints (F, J, 3) that are nowhere the same."""
    return np.random.default_rng(0).normal(size=(frames, joints, 3))


def tracked(raw: Array, name: str = "head") -> Tracked:
    """Something tracked, with these errors (F, 1)."""
    numbers = np.arange(len(raw))
    comparison = Comparison((name,), numbers, raw, raw / 2)
    return Tracked(comparison, np.full(len(raw), 0.05), {"tracked": len(raw)}, 1.0, 0.01, 1.75, 1.0)


def test_left_and_right_of_the_skeleton_change_places(tmp_path: Path) -> None:
    """The pictures are mirrored: the SDK's left wrist is our right one; its y points up, ours down."""
    skeleton = np.zeros((20, 3, 1))
    skeleton[SDK_JOINTS.index("left_wrist")] = [[0.1], [0.2], [2.5]]
    skeleton[SDK_JOINTS.index("right_knee")] = [[-0.3], [-0.4], [2.6]]
    skeleton[SDK_JOINTS.index("head")] = [[0.0], [0.8], [2.7]]
    joints = read_skeleton(write_skeleton(tmp_path / "skeleton.mat", skeleton))
    assert joints.shape == (1, len(JOINTS), 3)
    assert joints[0, JOINTS.index("right_wrist")] == pytest.approx([0.1, -0.2, 2.5])
    assert joints[0, JOINTS.index("left_knee")] == pytest.approx([-0.3, 0.4, 2.6])
    assert joints[0, JOINTS.index("head")] == pytest.approx([0.0, -0.8, 2.7])
    assert not joints[0, JOINTS.index("left_wrist")].any()


@pytest.mark.parametrize(("frames", "skeletons", "shared"), [(30, 30, 28), (30, 25, 25), (25, 30, 23)])
def test_the_skeleton_leads_by_two_frames(frames: int, skeletons: int, shared: int) -> None:
    """Depth frame t meets skeleton frame t - 2, whichever of the two is longer."""
    numbers = np.broadcast_to(np.arange(100.0)[:, None, None], (100, len(JOINTS), 3))
    mine, theirs = paired(numbers[:frames], numbers[:skeletons])
    assert len(mine) == len(theirs) == shared
    assert np.array_equal(mine - theirs, np.full_like(mine, 2.0))


def test_a_constant_offset_is_removed_and_nothing_else() -> None:
    """Raw errors are the offset of each joint; without it a single jump is left, whole."""
    reference = random_joints()
    offset = random_joints(1) / 10
    joints = reference + offset
    joints[7, 3] += [0.0, 0.3, 0.0]
    jump = np.zeros((FRAMES, len(JOINTS)))
    jump[7, 3] = 0.3
    assert distances(joints, reference, remove_offset=True) == pytest.approx(jump, abs=1e-12)
    calm = np.delete(distances(joints, reference, remove_offset=False), 7, axis=0)
    assert calm == pytest.approx(np.broadcast_to(np.linalg.norm(offset, axis=-1), calm.shape))


def test_people_are_compared_joint_by_joint_and_frame_by_frame(tmp_path: Path) -> None:
    """Joints in another order, two frames late and one joint off by 20 cm: only that one is wrong."""
    skeleton = np.random.default_rng(1).normal(size=(20, 3, FRAMES))
    path = write_skeleton(tmp_path / "skeleton.mat", skeleton)
    names = ("pelvis", *reversed(JOINTS))
    joints = np.full((FRAMES, len(names), 3), 9.0)
    joints[SKELETON_LEAD:, 1:] = read_skeleton(path)[:-SKELETON_LEAD, ::-1]
    joints[:, names.index("left_elbow")] += [0.2, 0.0, 0.0]
    compared = compare_people(path, names, joints, np.arange(100, 100 + FRAMES))
    expected = np.zeros((FRAMES - SKELETON_LEAD, len(JOINTS)))
    expected[:, JOINTS.index("left_elbow")] = 0.2
    assert compared.raw == pytest.approx(expected, abs=1e-12)
    assert compared.offset_removed == pytest.approx(np.zeros_like(expected), abs=1e-12)
    assert compared.frame[0] == 100 + SKELETON_LEAD
    assert compared.lost_from is None


def test_the_skinned_are_compared_at_the_same_frames_seen_and_unseen(tmp_path: Path) -> None:
    """Frames that only one side has do not count, and visibility goes with its joint and frame."""
    names, true = ("pelvis", "head"), random_joints(10, 2)
    visible = np.zeros((10, 2), dtype=bool)
    visible[:, 1] = True
    path = tmp_path / "truth.npz"
    np.savez(path, joint_names=names, joint_positions=true, visible=visible, frame=np.arange(10))
    joints = true[4:, ::-1].copy()
    joints[:, 1] += [0.0, 0.0, 0.25]  # the pelvis
    compared = compare_skinned(path, ("head", "pelvis"), joints, np.arange(4, 10))
    assert compared.frame.tolist() == list(range(4, 10))
    assert compared.visible is not None
    marks = score({"x": with_comparison(compared)}, [], raw=True).joints
    assert marks.visible == accuracy(np.zeros(6))
    assert marks.hidden == accuracy(np.full(6, 0.25))


def with_comparison(comparison: Comparison) -> Tracked:
    """Something tracked, with this comparison."""
    return Tracked(comparison, np.full(len(comparison.frame), 0.1), {}, 1.0, 0.01, 1.75, 1.0)


def test_nothing_in_common_is_no_perfect_score() -> None:
    """Without a shared frame there is an error, and no score."""
    nothing = np.empty((0, 1, 3))
    with pytest.raises(InputError, match="no frame in common"):
        compare(("head",), np.empty(0, dtype=np.int64), nothing, nothing)


def test_lost_means_more_than_thirty_centimetres_to_the_end() -> None:
    """A sequence that finds back is not lost; one that does not is, from the first such frame."""
    errors = np.full((FRAMES, 1), 0.05)
    errors[10:20] = 0.5
    assert tracked(errors).comparison.lost_from is None
    errors[25:] = 0.31
    assert tracked(errors).comparison.lost_from == 25
    assert score({"x": tracked(errors)}, [], raw=False).lost == ["x"]


def test_joints_are_pooled_over_sequences_and_the_worst_is_named() -> None:
    """A long sequence weighs more than a short one, except in the mean of the sequences."""
    good, bad = tracked(np.full((30, 1), 0.02)), tracked(np.full((10, 1), 0.4))
    both = score({"good": good, "bad": bad}, ["gone"], raw=True)
    assert both.joints.raw == accuracy(np.r_[np.full(30, 0.02), np.full(10, 0.4)])
    assert both.joints.raw is not None
    assert both.joints.raw.within_10cm_percent == 75.0
    assert both.joints.raw.mean_error_cm == pytest.approx((30 * 2 + 10 * 40) / 40)
    assert (both.worst, both.worst_percent, both.mean_of_sequences_percent) == ("bad", 0.0, 50.0)
    assert (both.sequences, both.frames, both.crashed) == (3, 40, ["gone"])
    assert both.ms_per_frame == 50.0


def test_each_joint_has_its_own_score() -> None:
    """One joint's error shows at that joint alone."""
    errors = np.tile([0.02, 0.3], (5, 1))
    by_joint = score_joints([Comparison(("head", "neck"), np.arange(5), errors, errors)])
    assert by_joint["head"].raw == accuracy(np.full(5, 0.02))
    assert by_joint["neck"].raw == accuracy(np.full(5, 0.3))
    assert by_joint["neck"].hidden is None


def fail_or_double(job: int) -> int:
    """Double a job; 0 raises, -1 dies at once."""
    if job == -1:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * (job // job) * job


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_a_crash_is_reported_and_the_others_go_on() -> None:
    """What raises and what is killed have a line each; all others have their results."""
    found = dict(run_forked(fail_or_double, [1, 0, 2, -1, 3], processes=2))
    assert [found[job] for job in (1, 2, 3)] == [2, 4, 6]
    raised, killed = found[0], found[-1]
    assert isinstance(raised, Crash)
    assert raised.error.startswith("ZeroDivisionError")
    assert "fail_or_double" in raised.trace
    assert isinstance(killed, Crash)
    assert "SIGKILL" in killed.error


def test_crashes_are_in_the_report() -> None:
    """A crashed sequence counts as a sequence of its action, and is listed with its error."""
    recordings = [Recording(name, Path(name), Path(name), 3) for name in ("a3_s1", "a3_s2")]
    crash = Crash("KeyError: it")
    results: Results = {"a3_s1": tracked(np.full((5, 1), 0.02)), "a3_s2": crash}
    outcome = report(recordings, results, Settings(), processes=1)
    assert outcome.crashes == {"a3_s2": "KeyError: it"}
    assert outcome.skinned is None
    assert outcome.people is not None
    assert outcome.people.by_action[3].sequences == 2
    assert outcome.people.overall.crashed == ["a3_s2"]
    assert divide(recordings, results)[1] == ["a3_s2"]


def test_settings_are_the_defaults_but_for_what_is_given() -> None:
    """Keys are found in any part of the settings; values keep their types."""
    assert settings_with([]) == preset("default")
    changed = settings_with(["icp_iterations=2", "explore=false", "seed=7"], particles=3)
    assert (changed.refine.icp_iterations, changed.filter.explore, changed.seed) == (2, False, 7)
    assert changed.filter.particles == 3
    assert settings_with(["preset=paper"]) == preset("paper")


@pytest.mark.parametrize("change", ["particles", "nonsense=1", "icp_iterations=many", "preset=none"])
def test_settings_that_make_no_sense_are_refused(change: str) -> None:
    """One line for the user, before anything is tracked."""
    with pytest.raises(InputError):
        settings_with([change])


def test_without_data_the_command_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2 and one line that names the option, no table."""
    assert main(["--data", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "--data" in err


@pytest.mark.skipif(not (DATA / "utd_mhad").exists(), reason="the UTD-MHAD data are not there")
def test_all_people_are_found_and_can_be_named() -> None:
    """27 actions of 4 subjects, in order; a whole action by its name, a single sequence by its own."""
    recordings = [r for r in find_recordings(DATA) if r.action is not None]
    assert len(recordings) == 108
    assert {r.action for r in recordings} == set(range(1, 28))
    assert all(r.joints.exists() for r in recordings)
    assert [r.name for r in choose(recordings, ["a2", "a14_s2"])] == [
        "a2_s1", "a2_s2", "a2_s3", "a2_s4", "a14_s2",
    ]  # fmt: skip
    with pytest.raises(InputError, match="no sequence 'a99'"):
        choose(recordings, ["a99"])


@pytest.mark.skipif(not (DATA / "utd_mhad").exists(), reason="the UTD-MHAD data are not there")
def test_the_right_side_of_a_recorded_person_is_at_image_left() -> None:
    """The first person recorded faces the camera upright: the mirrored skeleton agrees with the picture."""
    recording = next(r for r in find_recordings(DATA) if r.action is not None)
    first = dict(zip(JOINTS, read_skeleton(recording.joints)[0], strict=True))
    assert first["right_shoulder"][0] < first["left_shoulder"][0]
    assert first["right_hip"][0] < first["left_hip"][0]
    assert first["head"][1] < first["right_hip"][1] < first["right_ankle"][1]
