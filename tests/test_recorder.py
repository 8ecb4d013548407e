"""A run's folder: durable frame by frame, whole files at the end, never two runs in one place."""

from __future__ import annotations

import csv
import json
import zipfile
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import InputError
from coordinator.atomic_file import write_atomically
from coordinator.estimate import Estimate, Status
from coordinator.exports import export_run
from coordinator.frame_log import read_records
from coordinator.recorder import Recorder, read_log
from coordinator.track import Track, read_track

DOFS, JOINTS = ("root_tx", "root_rx", "r_elbow_flexion"), ("pelvis", "right_wrist")


def estimate(number: int, hypotheses: int = 2, status: Status = "tracked") -> Estimate:
    """An estimate that is told apart from every other by its values."""
    rng = np.random.default_rng(number)
    poses = rng.normal(size=(hypotheses, len(DOFS)))
    return Estimate(
        frame=number,
        time_s=number / 30,
        status=status,
        pose=poses[0],
        joint_positions=rng.normal(size=(len(JOINTS), 3)),
        hypothesis_pose=poses,
        hypothesis_weight=np.full(hypotheses, 1 / hypotheses),
        residual=float("nan") if status == "lost" else 0.01,
        stage_seconds={"refine": rng.random()},
    )


ESTIMATES = [estimate(4, 1), estimate(5, 3, "ambiguous"), estimate(6, 2, "lost")]


def record(folder: Path, estimates: list[Estimate], *, complete: bool = True) -> None:
    """A whole run."""
    with Recorder(folder) as recorder:
        recorder.open_with(DOFS, JOINTS)
        for each in estimates:
            recorder.append(each)
        recorder.finish({"frames": len(estimates)}, complete=complete)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a finished run."""
    record(tmp_path / "run", ESTIMATES)
    return tmp_path / "run"


def names(folder: Path) -> list[str]:
    """What a folder holds."""
    return sorted(path.name for path in folder.iterdir())


def test_a_run_leaves_its_three_files_and_nothing_else(run: Path) -> None:
    """The log is gone, so are the drafts."""
    assert names(run) == ["poses.csv", "summary.json", "track.npz"]
    assert json.loads((run / "summary.json").read_text()) == {"frames": 3}


def test_the_track_has_the_fields_shapes_and_types_of_the_contract(run: Path) -> None:
    """Another program reads exactly this, without unpickling."""
    with np.load(run / "track.npz", allow_pickle=False) as file:
        arrays = dict(file)
    assert {key: (value.dtype.str, value.shape) for key, value in arrays.items()} == {
        "frame": ("<i8", (3,)),
        "time_s": ("<f8", (3,)),
        "dof_names": ("<U15", (3,)),
        "pose": ("<f8", (3, 3)),
        "joint_names": ("<U11", (2,)),
        "joint_positions": ("<f8", (3, 2, 3)),
        "hypothesis_pose": ("<f8", (3, 3, 3)),
        "hypothesis_weight": ("<f8", (3, 3)),
        "status": ("<U9", (3,)),
    }
    assert arrays["frame"].tolist() == [4, 5, 6]
    assert arrays["status"].tolist() == ["tracked", "ambiguous", "lost"]


def test_values_come_through_bit_by_bit_and_missing_hypotheses_are_nan(run: Path) -> None:
    """What the tracker said is what stands in the file."""
    track = read_track(run)
    for f, each in enumerate(ESTIMATES):
        count = len(each.hypothesis_weight)
        np.testing.assert_array_equal(track.pose[f], each.pose)
        np.testing.assert_array_equal(track.joint_positions[f], each.joint_positions)
        np.testing.assert_array_equal(track.hypothesis_pose[f, :count], each.hypothesis_pose)
        np.testing.assert_array_equal(track.hypothesis_weight[f, :count], each.hypothesis_weight)
        assert np.isnan(track.hypothesis_pose[f, count:]).all()
        assert np.isnan(track.hypothesis_weight[f, count:]).all()


def test_equal_runs_give_equal_bytes(tmp_path: Path, run: Path) -> None:
    """Neither the time nor the place of a run is in its track; time taken is in the summary only."""
    record(tmp_path / "elsewhere" / "other", ESTIMATES)
    assert (run / "track.npz").read_bytes() == (tmp_path / "elsewhere" / "other" / "track.npz").read_bytes()
    with zipfile.ZipFile(run / "track.npz") as file:
        assert {entry.date_time for entry in file.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_frame_is_in_the_file_before_the_next_begins(tmp_path: Path) -> None:
    """A reader of the folder sees each frame as soon as append returns."""
    with Recorder(tmp_path / "run") as recorder:
        recorder.open_with(DOFS, JOINTS)
        for count, each in enumerate(ESTIMATES, start=1):
            recorder.append(each)
            opening, recorded = read_log(tmp_path / "run" / "frames.log")
            assert (opening.dof_names, opening.joint_names, len(recorded)) == (DOFS, JOINTS, count)
            np.testing.assert_array_equal(recorded[-1].hypothesis_pose, each.hypothesis_pose)
            assert recorded[-1].stage_seconds == each.stage_seconds
            np.testing.assert_equal(recorded[-1].residual, each.residual)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The log of a run that stopped after three frames."""
    folder = tmp_path_factory.mktemp("interrupted")
    record(folder, ESTIMATES, complete=False)
    return (folder / "frames.log").read_bytes()


@given(data=st.data())
def test_a_log_torn_anywhere_gives_the_whole_records_before(log: bytes, data: st.DataObject) -> None:
    """Power may fail at any byte: what was written before is read, what follows is not guessed."""
    whole = list(read_records(log))
    assert len(whole) == 4
    torn = list(read_records(log[: data.draw(st.integers(0, len(log) - 1))]))
    assert torn == whole[: len(torn)]
    assert len(torn) < 4


@given(data=st.data())
def test_a_log_with_an_altered_byte_gives_only_records_that_were_written(
    log: bytes, data: st.DataObject
) -> None:
    """A damaged disk does not make up results."""
    whole = list(read_records(log))
    changed = bytearray(log)
    changed[data.draw(st.integers(0, len(log) - 1))] ^= data.draw(st.integers(1, 255))
    found = list(read_records(bytes(changed)))
    assert found == whole[: len(found)]
    assert len(found) < 4


def test_a_run_that_ends_early_keeps_its_log_beside_the_results(tmp_path: Path) -> None:
    """What there is can be read like any run, and could be gone on with."""
    record(tmp_path, ESTIMATES[:2], complete=False)
    assert names(tmp_path) == ["frames.log", "poses.csv", "summary.json", "track.npz"]
    assert read_track(tmp_path).frame.tolist() == [4, 5]


def test_without_a_frame_no_folder_stays(tmp_path: Path) -> None:
    """A run that fails before its first frame leaves nothing, not even folders above."""
    with pytest.raises(ZeroDivisionError), Recorder(tmp_path / "a" / "b" / "run"):
        raise ZeroDivisionError
    assert names(tmp_path) == []


def test_a_folder_that_was_there_stays_with_all_it_held(tmp_path: Path) -> None:
    """Other people's files are left alone, whether the run fails or not."""
    (tmp_path / "notes.txt").write_text("mine")
    with Recorder(tmp_path):
        pass
    assert names(tmp_path) == ["notes.txt"]
    record(tmp_path, ESTIMATES)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_folder_in_use_is_refused_and_the_run_in_it_goes_on(tmp_path: Path) -> None:
    """Two runs never write into one folder."""
    with Recorder(tmp_path / "run") as recorder:
        with pytest.raises(InputError, match="in use by a run that is still going on"):
            Recorder(tmp_path / "run")
        recorder.open_with(DOFS, JOINTS)
        recorder.append(ESTIMATES[0])
        recorder.finish({})
    assert read_track(tmp_path / "run").frame.tolist() == [4]


def test_an_earlier_run_is_never_written_over(run: Path) -> None:
    """Its files stay byte for byte, and no log is left beside them."""
    before = {path: path.read_bytes() for path in run.iterdir()}
    with pytest.raises(InputError, match=r"holds an earlier run.*choose another --out"):
        Recorder(run)
    assert {path: path.read_bytes() for path in run.iterdir()} == before


def test_an_interrupted_run_is_never_written_over(tmp_path: Path) -> None:
    """Its log may be all that there is of a long run."""
    record(tmp_path, ESTIMATES[:1], complete=False)
    before = (tmp_path / "frames.log").read_bytes()
    with pytest.raises(InputError, match="holds an interrupted run"):
        Recorder(tmp_path)
    assert (tmp_path / "frames.log").read_bytes() == before


def test_a_log_without_a_frame_is_no_reason_to_refuse(tmp_path: Path) -> None:
    """A run that was killed before its first frame leaves an empty log, which holds nothing to lose."""
    (tmp_path / "frames.log").touch()
    record(tmp_path, ESTIMATES)
    assert names(tmp_path) == ["poses.csv", "summary.json", "track.npz"]


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    """A file where the folder should be, and a file above it."""
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "run", Path("/proc/run")):
        with pytest.raises(InputError, match="cannot write to"):
            Recorder(folder)
    assert names(tmp_path) == ["file"]


def test_a_file_that_fails_half_way_does_not_come_to_be(tmp_path: Path) -> None:
    """Neither the file nor its draft; what was there before stays."""
    path = tmp_path / "results"
    path.write_text("before")

    def fail(file: BinaryIO) -> None:
        file.write(b"half of it")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        write_atomically(path, fail)
    assert names(tmp_path) == ["results"]
    assert path.read_text() == "before"


def test_the_csv_gives_back_the_same_numbers(run: Path) -> None:
    """One line a frame; every number reads as the float64 it was."""
    track = read_track(run)
    with (run / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["status"] for row in rows] == ["tracked", "ambiguous", "lost"]
    assert [int(row["frame"]) for row in rows] == [4, 5, 6]
    pose = [[float(row[name]) for name in DOFS] for row in rows]
    wrist = [[float(row[f"right_wrist_{axis}"]) for axis in "xyz"] for row in rows]
    np.testing.assert_array_equal(pose, track.pose)
    np.testing.assert_array_equal(wrist, track.joint_positions[:, 1])


def test_exports_hold_the_track(tmp_path: Path, run: Path) -> None:
    """CSV is that of the run; JSON has all fields, with null where hypotheses are missing."""
    track = read_track(run)
    export_run(run, "csv", tmp_path / "poses")
    export_run(run, "json", tmp_path / "poses.json")
    assert (tmp_path / "poses").read_bytes() == (run / "poses.csv").read_bytes()
    content = json.loads((tmp_path / "poses.json").read_text())
    assert set(content) == set(Track.__slots__)
    assert content["pose"] == track.pose.tolist()
    assert content["hypothesis_weight"][0] == [1.0, None, None]


def test_exports_refuse_what_they_cannot_do(tmp_path: Path, run: Path) -> None:
    """An unknown format names the known ones; a place that cannot be written is named."""
    with pytest.raises(
        InputError, match="unknown format 'fbx'; choose from bap, bvh, csv, glb, gltf, json, trc"
    ):
        export_run(run, "fbx", tmp_path / "poses.fbx")
    with pytest.raises(InputError, match="cannot write"):
        export_run(run, "csv", tmp_path / "nowhere" / "poses.csv")
    assert names(tmp_path) == ["run"]
