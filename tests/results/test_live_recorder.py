"""The folder of a live run: finished after a kill at any byte, one run in a place, in little memory."""

from __future__ import annotations

import gc
import json
import random
import shutil
import tracemalloc
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from gepf.common.errors import InputError
from gepf.coordinator.cli import main
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.killed import finish_killed
from gepf.coordinator.results.live_recorder import LiveRecorder, Unstored, finish_log, read_frames
from gepf.coordinator.results.recorder import Recorder
from gepf.coordinator.results.summary import read_summary
from gepf.coordinator.results.tally import Tally
from gepf.coordinator.results.track import read_track
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.reporting import TrackedFrame, TrackedPerson
from gepf.coordinator.tracking.state import PersonState
from tests.support.recorded import CONFIGURATION, START, estimate, frame_state, names, record, state

FRAMES = 40
KINDS = ("tracked", "ambiguous", "lost")
UNFOUND = replace(START, found=False, pose=np.full_like(START.pose, np.nan))


def unfound(number: int) -> Estimate:
    """An estimate before the body is found: without hypotheses, and with values that are unknown."""
    known = estimate(number, status="lost")
    return replace(
        known,
        status="absent",
        why="nobody",
        pose=np.full_like(known.pose, np.nan),
        joint_positions=np.full_like(known.joint_positions, np.nan),
        hypothesis_pose=np.empty((0, len(known.pose))),
        hypothesis_weight=np.empty(0),
    )


def frames(count: int = FRAMES) -> list[Estimate]:
    """Estimates of a run in which the body is found in the third frame."""
    first = [unfound(0), unfound(1)]
    return first + [estimate(n, 1 + n % 4, KINDS[n % 3]) for n in range(2, count)]  # type: ignore[arg-type]


def append(recorder: LiveRecorder | Recorder | Unstored, estimates: Sequence[Estimate]) -> None:
    """Record frames of one person."""
    for each in estimates:
        start = START if each.frame >= 2 else UNFOUND
        people = [TrackedPerson(each, PersonState(start, state(each.frame).checkpoint))]
        tracked = TrackedFrame(people, frame_state(each.frame))
        recorder.append(tracked, PoolStatistics(("a",), {"batches_sent": each.frame}), each.frame / 10)


def record_live(run: Path, estimates: Sequence[Estimate], *, killed: bool = False) -> None:
    """Record a whole live run, or what a kill leaves of it."""
    with LiveRecorder(run, CONFIGURATION, {"workers": 1}) as recorder:
        append(recorder, estimates)
        if killed:
            shutil.copytree(run, run.with_name("copy"))
        else:
            recorder.finish({"complete": True, "pool": {"workers": 1}}, 0.0)
    if killed:
        shutil.rmtree(run, ignore_errors=True)
        run.with_name("copy").rename(run)


@pytest.fixture(scope="module")
def container(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The container of a killed live run."""
    run = tmp_path_factory.mktemp("killed") / "run"
    record_live(run, frames(), killed=True)
    return (run / "live.mcap").read_bytes()


@pytest.fixture
def killed(container: bytes, tmp_path: Path) -> Path:
    """The folder of a killed live run."""
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "live.mcap").write_bytes(container)
    return tmp_path / "run"


def contents(run: Path) -> dict[str, bytes]:
    """The bytes of all files in a folder, by name."""
    return {path.name: path.read_bytes() for path in run.iterdir()}


def test_a_live_run_writes_the_files_of_a_recorded_run(tmp_path: Path) -> None:
    """Byte for byte, values that JSON has no number for included; the container is gone.

    Only the arrays of `track.npz` are compressed, so that padding to the frame with the most hypotheses takes
    no room.
    """
    estimates = [*frames(), *(estimate(n, 80) for n in range(FRAMES, FRAMES + 3))]
    record_live(tmp_path / "live", estimates)
    with Recorder(tmp_path / "recorded", CONFIGURATION) as recorder:
        append(recorder, estimates)
        recorder.finish({"complete": True, "pool": {"workers": 1}}, 0.0)
    live, recorded = contents(tmp_path / "live"), contents(tmp_path / "recorded")
    packed, plain = live.pop("track.npz"), recorded.pop("track.npz")
    assert live == recorded
    with ZipFile(BytesIO(packed)) as one, ZipFile(BytesIO(plain)) as other:
        assert [(name, one.read(name)) for name in one.namelist()] == [
            (name, other.read(name)) for name in other.namelist()
        ]
    assert len(packed) < len(plain) / 4


def test_a_killed_run_is_finished_when_it_is_read(killed: Path, caplog: pytest.LogCaptureFixture) -> None:
    """All its frames are there, the summary says that it is not complete, and a line how many there are."""
    finish_killed(killed)
    assert names(killed) == ["model.npz", "poses.csv", "summary.json", "track.npz"]
    track, summary = read_track(killed), read_summary(killed)
    assert track.frame.tolist() == list(range(FRAMES))
    assert (summary["complete"], summary["frames"], summary["pool"]) == (False, FRAMES, {"workers": 1})
    assert caplog.messages == [
        f"the live run in {killed} was killed; its {FRAMES} frames are now in its results"
    ]
    before = contents(killed)
    finish_killed(killed)
    assert contents(killed) == before


def test_a_container_torn_at_any_byte_is_finished(container: bytes, tmp_path: Path) -> None:
    """Of 50 random places: every frame that was wholly written before is in the results, and no other."""
    ends = ends_of_frames(container, tmp_path / "whole")
    assert len(ends) == FRAMES
    rng = random.Random(7)
    places = sorted({*rng.sample(range(ends[0], len(container)), 50), ends[0], len(container) - 1})
    for place in places:
        run = tmp_path / str(place)
        run.mkdir()
        (run / "live.mcap").write_bytes(container[:place])
        finish_killed(run)
        assert len(read_track(run).frame) == sum(end <= place for end in ends)
        assert read_summary(run)["frames"] == len(read_track(run).frame)


def test_an_altered_byte_ends_the_run_before_it(container: bytes, tmp_path: Path) -> None:
    """As after a loss of power: the frames are those written, up to the altered one, and no others.

    Every byte of the second frame is altered, the sizes in its head among them, and random others.
    """
    ends, path, rng = ends_of_frames(container, tmp_path / "whole"), tmp_path / "live.mcap", random.Random(3)
    for place in [*range(ends[0], ends[1]), *rng.sample(range(ends[1], len(container)), 50)]:
        altered = bytearray(container[: max(place + 1, ends[2])])
        altered[place] ^= rng.choice((0x80, 0xFF, rng.randrange(1, 256)))
        path.write_bytes(altered)
        count = sum(1 for _ in read_frames(path))
        whole = sum(end <= place for end in ends)
        assert whole <= count <= FRAMES
        for frame, expected in zip(read_frames(path), frames(), strict=False):
            assert frame.people[0].estimate["frame"] == expected.frame
            if expected.frame >= 2:
                assert frame.people[0].estimate["pose"] == expected.pose.tolist()


def ends_of_frames(container: bytes, path: Path) -> list[int]:
    """Where each frame of a container ends: the end of its chunk, as another reader of MCAP finds it."""
    path.write_bytes(container)
    ends: list[int] = []
    with path.open("rb") as file:
        records = StreamReader(file, emit_chunks=True).records
        with suppress(EndOfFile):
            ends.extend(file.tell() for each in records if isinstance(each, Chunk))
    return ends


def test_a_run_killed_before_its_first_frame_holds_nothing(container: bytes, tmp_path: Path) -> None:
    """Its folder is no reason to refuse a new run; to read it says what to delete."""
    for place in (0, 5, 30, 200):
        run = tmp_path / str(place)
        run.mkdir()
        (run / "live.mcap").write_bytes(container[:place])
        with pytest.raises(InputError, match=r"was killed before its first frame; delete .*live\.mcap"):
            finish_killed(run)
        record_live(run, frames(5))
        assert len(read_track(run).frame) == 5


def test_people_of_a_killed_run_have_their_folders(tmp_path: Path) -> None:
    """The folder of one of them, which is not there yet, can be given; who was never found has none."""
    run = tmp_path / "run"
    with LiveRecorder(run, CONFIGURATION, {}) as recorder:
        for each in frames(5):
            after = state(each.frame).checkpoint
            starts = [UNFOUND, START if each.frame >= 2 else UNFOUND, UNFOUND]
            people = [TrackedPerson(each, PersonState(start, after)) for start in starts]
            recorder.append(TrackedFrame(people, frame_state(each.frame)), PoolStatistics(), 1.0)
    finish_killed(run / "person2")
    assert names(run) == ["person1", "person2", "summary.json"]
    assert len(read_track(run / "person2").frame) == 5
    assert [each["folder"] for each in read_summary(run)["found"]] == ["person1", "person2"]


def test_a_kill_while_it_is_finished_loses_nothing(killed: Path) -> None:
    """The container goes last; results that are there already are written again."""
    finish_log(killed, {})
    (killed / "poses.csv").unlink()
    (killed / "track.npz").write_bytes(b"half")
    finish_killed(killed)
    assert len(read_track(killed).frame) == FRAMES
    assert names(killed) == ["model.npz", "poses.csv", "summary.json", "track.npz"]


def test_a_live_run_that_goes_on_is_not_finished(tmp_path: Path) -> None:
    """Nothing is written beside it, no second run begins there, and it ends as ever."""
    run = tmp_path / "run"
    with LiveRecorder(run, CONFIGURATION, {}) as recorder:
        append(recorder, frames(3))
        assert sum(1 for _ in read_frames(run / "live.mcap")) == 3
        with pytest.raises(InputError, match=r"the live run in .* has not ended; end it with Ctrl-C"):
            finish_killed(run)
        with pytest.raises(InputError, match="in use by another run"):
            LiveRecorder(run, CONFIGURATION, {})
        with pytest.raises(InputError, match="in use by another run"):
            Recorder(run, CONFIGURATION)
        assert names(run) == ["live.mcap"]
        recorder.finish({"complete": True}, 0.0)
    assert names(run) == ["model.npz", "poses.csv", "summary.json", "track.npz"]


@pytest.mark.parametrize("live", [True, False])
def test_a_killed_live_run_is_never_written_over(killed: Path, *, live: bool) -> None:
    """A new run in its folder is refused, with what to do; nothing changes."""
    before = contents(killed)
    says = r"holds a live run that was killed; finish it with gepf report .*, choose another --out"
    with pytest.raises(InputError, match=says):
        LiveRecorder(killed, CONFIGURATION, {}) if live else Recorder(killed, CONFIGURATION)
    assert contents(killed) == before


@pytest.mark.parametrize(
    ("complete", "says"), [(True, "an earlier run"), (False, "interrupted run of a rec")]
)
def test_a_live_run_does_not_write_over_a_recorded_one(tmp_path: Path, complete: bool, says: str) -> None:
    """A finished one and an interrupted one stay byte for byte."""
    record(tmp_path, frames(4), complete=complete)
    before = contents(tmp_path)
    with pytest.raises(InputError, match=says):
        LiveRecorder(tmp_path, CONFIGURATION, {})
    assert contents(tmp_path) == before


def test_a_live_run_without_a_frame_leaves_nothing(tmp_path: Path) -> None:
    """Neither the folder nor a container."""
    with LiveRecorder(tmp_path / "deep" / "run", CONFIGURATION, {}) as recorder:
        assert recorder.finish({}, 0.0) == {}
    assert names(tmp_path) == []


def test_any_reader_of_mcap_sees_the_estimates(killed: Path) -> None:
    """Topics, times and JSON are those of the container's specification."""
    seen = []
    with (killed / "live.mcap").open("rb") as file, suppress(EndOfFile):  # it has no end
        for _, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            if channel.message_encoding == "json":
                seen.append((channel.topic, json.loads(message.data)))
    assert [topic for topic, _ in seen] == ["run", *["frames"] * FRAMES]
    assert seen[0][1]["configuration"] == CONFIGURATION
    last = seen[-1][1]["people"][0]["estimate"]
    assert (last["frame"], last["pose"]) == (FRAMES - 1, frames()[-1].pose.tolist())


def test_finishing_a_longer_run_takes_hardly_more_memory(tmp_path: Path) -> None:
    """Of each further frame less than a tenth of its estimate stays in memory; arrays are in files."""
    peaks = []
    for count in (1500, 3000):
        run = tmp_path / str(count)
        record_live(run, frames(count), killed=True)
        finish_log(run, {})  # loads what is loaded once
        tracemalloc.start()
        finish_log(run, {})
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    size = (tmp_path / "3000" / "live.mcap").stat().st_size / 3000
    assert (peaks[1] - peaks[0]) / 1500 < 0.1 * size


def open_files() -> int:
    """Number of open files of this process."""
    return sum(1 for _ in Path("/proc/self/fd").iterdir())


def test_a_process_holds_few_files_however_long_a_run_is(tmp_path: Path) -> None:
    """Recording and finishing keep no file open."""
    before = open_files()
    with LiveRecorder(tmp_path / "run", CONFIGURATION, {}) as recorder:
        append(recorder, frames(2))
        few = open_files()
        append(recorder, [replace(each, frame=each.frame + 2) for each in frames(100)[2:]])
        assert open_files() <= few
        recorder.finish({"complete": True}, 0.0)
    gc.collect()
    assert open_files() <= before


def test_without_a_folder_frames_are_counted(tmp_path: Path) -> None:
    """Who was found, in how many frames of which status."""
    with Unstored() as recorder:
        append(recorder, frames(5))
        (person,) = recorder.finish({}, 0.0).values()
    assert (recorder.frames, person.found) == (5, True)
    assert person.tally == Tally.of(frames(5))
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    "command",
    [
        "export {run} --to csv --out {run}/x.csv",
        "report {run}",
        "info {run}",
        "evaluate {run} --truth {truth}",
        "view {run} --save {run}/x.rrd",
    ],
)
def test_every_command_that_reads_a_run_finishes_it(
    killed: Path, command: str, caplog: pytest.LogCaptureFixture
) -> None:
    """It does what it does for a whole run, after one line."""
    truth = killed.parent / "truth.npz"
    joints = np.zeros((FRAMES, 2, 3))
    np.savez(truth, joint_names=np.array(START.model.joint_names), joint_positions=joints)
    assert main(command.format(run=killed, truth=truth).split()) == 0
    assert f"its {FRAMES} frames are now in its results" in caplog.messages[0]
    assert len(read_track(killed).frame) == FRAMES
    assert "live.mcap" not in names(killed)
