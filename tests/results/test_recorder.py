"""A run's folder: durable frame by frame, whole files at the end, never two runs in one place."""

from __future__ import annotations

import csv
import itertools
import tempfile
from dataclasses import fields
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gepf.common.errors import InputError
from gepf.coordinator.files import write_atomically
from gepf.coordinator.filters.belief import Belief
from gepf.coordinator.results.log import read_log, read_records
from gepf.coordinator.results.recorder import Recorder
from gepf.coordinator.results.track import read_track
from gepf.coordinator.tracking.track_state import Tracked
from tests.support.recorded import CONFIGURATION, DOFS, ESTIMATES, MODEL, append, names, record, state


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The folder of a finished run."""
    record(tmp_path / "run", ESTIMATES)
    return tmp_path / "run"


def test_the_track_has_the_fields_shapes_and_types_of_the_contract(run: Path) -> None:
    """Another program reads exactly this, without unpickling."""
    with np.load(run / "track.npz", allow_pickle=False) as file:
        arrays = dict(file)
    assert {key: (value.dtype.str, value.shape) for key, value in arrays.items()} == {
        "frame": ("<i8", (3,)),
        "time_s": ("<f8", (3,)),
        "dof_names": ("<U7", (6,)),
        "pose": ("<f8", (3, 6)),
        "joint_names": ("<U11", (2,)),
        "joint_positions": ("<f8", (3, 2, 3)),
        "hypothesis_pose": ("<f8", (3, 3, 6)),
        "hypothesis_weight": ("<f8", (3, 3)),
        "status": ("<U9", (3,)),
        "joint_deviation": ("<f8", (3, 2)),
        "joint_off_probability": ("<f8", (3, 2)),
        "joint_seen": ("<f8", (3, 2)),
        "angle_names": ("<U17", (3,)),
        "angle": ("<f8", (3, 3)),
        "angle_deviation": ("<f8", (3, 3)),
    }
    assert arrays["frame"].tolist() == [4, 5, 6]
    assert arrays["status"].tolist() == ["tracked", "ambiguous", "lost"]


def test_values_come_through_bit_by_bit_and_missing_hypotheses_are_nan(run: Path) -> None:
    """The file holds the tracker's values."""
    track = read_track(run)
    for f, each in enumerate(ESTIMATES):
        count = len(each.hypothesis_weight)
        np.testing.assert_array_equal(track.pose[f], each.pose)
        np.testing.assert_array_equal(track.joint_positions[f], each.joint_positions)
        np.testing.assert_array_equal(track.hypothesis_pose[f, :count], each.hypothesis_pose)
        np.testing.assert_array_equal(track.hypothesis_weight[f, :count], each.hypothesis_weight)
        assert np.isnan(track.hypothesis_pose[f, count:]).all()
        for what in ("seen", "off_probability", "deviation"):
            np.testing.assert_array_equal(getattr(track, f"joint_{what}")[f], getattr(each.certainty, what))
        assert np.isnan(track.hypothesis_weight[f, count:]).all()


def test_a_frame_is_in_the_file_before_the_next_begins(tmp_path: Path) -> None:
    """A reader of the folder sees each frame as soon as append returns."""
    with Recorder(tmp_path / "run", CONFIGURATION) as recorder:
        for count, each in enumerate(ESTIMATES, start=1):
            append(recorder, each)
            recorded = read_log(tmp_path / "run" / "frames.log")
            assert recorded is not None
            assert (recorded.configuration, recorded.frames) == (CONFIGURATION, count)
            assert (recorded.statistics.counts["batches_sent"], recorded.seconds) == (2, each.frame / 10)
            (one,) = recorded.people
            assert one.state.start.model.hash == MODEL.hash
            assert one.state.checkpoint.generator == state(each.frame).checkpoint.generator
            recorded_track, track = one.state.track, state(each.frame).track
            assert isinstance(recorded_track, Tracked)
            assert isinstance(track, Tracked)
            for field in fields(Belief):
                values = getattr(track.belief, field.name)
                assert getattr(recorded_track.belief, field.name).tobytes() == values.tobytes()
            last = one.estimates[-1]
            np.testing.assert_array_equal(last.hypothesis_pose, each.hypothesis_pose)
            assert last.stage_seconds == each.stage_seconds
            np.testing.assert_equal(last.residual, each.residual)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The log of a run that stopped after three frames."""
    folder = tmp_path_factory.mktemp("interrupted")
    record(folder, ESTIMATES, complete=False)
    return (folder / "frames.log").read_bytes()


def records_of(content: bytes) -> list[bytes]:
    """The bytes of the whole records of a log."""
    with tempfile.TemporaryFile() as file:
        file.write(content)
        file.seek(0)
        ends = [0, *(end for _, end in read_records(file))]
    return [content[start:end] for start, end in itertools.pairwise(ends)]


@given(data=st.data())
def test_a_log_torn_anywhere_gives_the_whole_records_before(log: bytes, data: st.DataObject) -> None:
    """After a power failure at any byte, or a changed byte, all records before it are read, and no others."""
    whole = records_of(log)
    assert b"".join(whole) == log
    at = data.draw(st.integers(0, len(log) - 1))
    altered = bytearray(log)
    altered[at] ^= data.draw(st.integers(1, 255))
    for damaged in (log[:at], bytes(altered)):
        found = records_of(damaged)
        assert found == whole[: len(found)]
        assert len(found) < len(whole) == 4


def test_a_folder_that_was_there_stays_with_all_it_held(tmp_path: Path) -> None:
    """Other people's files are left alone, whether the run fails or not."""
    (tmp_path / "notes.txt").write_text("mine")
    with Recorder(tmp_path, CONFIGURATION):
        pass
    assert names(tmp_path) == ["notes.txt"]
    record(tmp_path, ESTIMATES)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_folder_in_use_is_refused_and_the_run_in_it_goes_on(tmp_path: Path) -> None:
    """Two runs never write into one folder."""
    with Recorder(tmp_path / "run", CONFIGURATION) as recorder:
        for resume in (False, True):
            with pytest.raises(InputError, match="in use by another run"):
                Recorder(tmp_path / "run", CONFIGURATION, resume=resume)
        append(recorder, ESTIMATES[0])
    recorded = read_log(tmp_path / "run" / "frames.log")
    assert recorded is not None
    assert [each.frame for each in recorded.people[0].estimates] == [4]


@pytest.mark.parametrize(
    ("complete", "says"),
    [
        (True, r"holds an earlier run.*choose another --out"),
        (False, r"holds an interrupted run; continue it with --resume, choose"),
    ],
)
def test_an_earlier_run_is_never_written_over(tmp_path: Path, complete: bool, says: str) -> None:
    """Its files stay byte for byte; the log of an interrupted one may be the only result of a long run."""
    record(tmp_path, ESTIMATES[:1], complete=complete)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    assert (tmp_path / "frames.log" in before) != complete
    with pytest.raises(InputError, match=says):
        Recorder(tmp_path, CONFIGURATION)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_log_without_a_frame_is_no_reason_to_refuse(tmp_path: Path) -> None:
    """A run that was killed before its first frame leaves an empty log, which holds nothing to lose."""
    (tmp_path / "frames.log").touch()
    record(tmp_path, ESTIMATES)
    assert names(tmp_path) == ["model.npz", "poses.csv", "summary.json", "track.npz"]


def test_a_file_that_fails_half_way_does_not_come_to_be(tmp_path: Path) -> None:
    """Neither the file nor its temporary file; an existing file is unchanged."""
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
    found = [[float(row[f"{name}_deg"]) for name in track.angle_names] for row in rows]
    np.testing.assert_array_equal(found, np.degrees(track.angle))
    assert list(rows[0])[3] == f"{track.angle_names[0]}_deg"
    assert [row[f"{track.angle_names[0]}_deviation_deg"] == "nan" for row in rows] == [False, False, True]
