"""`gepf track --people`: a run for each person, one summary, the same bytes after interruptions."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

import gepf
from gepf.common.frame import SubjectFrame
from gepf.common.protocol.frames import LIVE_END, encode_live
from gepf.coordinator.cli import main
from gepf.coordinator.files import LOG_FILE
from tests.support.live import Listener, listening, publishing
from tests.support.pairs import FRAMES, STATURES, pair, write_pair
from tests.support.people import CAMERA, frame_of
from tests.support.processes.certificates import free_port
from tests.support.recordings import write_open3d
from tests.support.rooms import in_a_room
from tests.support.stand_ins import Direct

OPTIONS = ("--people", "2", "--particles", "6", "--points", "1500", "--no-pictures")


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people in a room, with the truth of the one at the left."""
    return write_pair(tmp_path_factory.mktemp("sequences") / "pair")


@pytest.fixture(scope="module")
def calm(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nothing interrupted."""
    out = tmp_path_factory.mktemp("runs") / "calm"
    assert track(sequence, out) == 0
    return out


def track(sequence: Path, out: Path, *options: str, until: int | None = None) -> int:
    """`gepf track --people 2` in this process, interrupted at a frame."""
    workers = Interrupted(until)
    return main(["track", str(sequence), "--out", str(out), *OPTIONS, *options], workers.connect)


class Interrupted(Direct):
    """Refines in this process, until Ctrl-C at a frame."""

    def __init__(self, until: int | None) -> None:
        super().__init__()
        self._until = until

    def publish(self, subject: SubjectFrame) -> None:
        """Raise the interrupt at its frame."""
        if subject.number == self._until:
            raise KeyboardInterrupt
        super().publish(subject)


def test_each_person_is_a_run(calm: Path, sequence: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Found with stature and place; evaluated, exported, reported and loaded as any other run."""
    summary = json.loads((calm / "summary.json").read_text())
    assert (summary["people"], summary["frames"], summary["complete"]) == (2, FRAMES, True)
    assert [each["folder"] for each in summary["found"]] == ["person1", "person2"]
    runs = [gepf.load(calm / each["folder"]) for each in summary["found"]]
    order = np.argsort([run.joint("pelvis")[0, 0] for run in runs])
    for place, shown, stature in zip(order, pair(), STATURES, strict=True):
        names = list(runs[place].joint_names)
        off = np.linalg.norm(runs[place].track.joint_positions - shown.joints, axis=-1)
        assert len(names) == off.shape[1]
        assert off.mean(axis=1).max() < 0.04
        assert summary["found"][place]["stature_m"] == pytest.approx(stature, abs=0.12)
        assert summary["found"][place]["status"]["tracked"] >= FRAMES - 1
    left = calm / f"person{order[0] + 1}"
    capsys.readouterr()
    assert main(["evaluate", str(left), "--truth", str(sequence / "truth.npz")]) == 0
    assert json.loads(capsys.readouterr().out)["mean_joint_error_cm"] < 4.0
    assert main(["export", str(left), "--to", "bvh", "--out", str(left.parent / "left.bvh")]) == 0
    assert main(["report", str(left), "--out", str(left.parent / "left.html")]) == 0
    assert main(["report", str(calm)]) == 0
    page = (calm / "report.html").read_text()
    assert all(f"<h2>person{number}</h2>" in page for number in (1, 2))


def test_a_truth_is_not_taken_for_anybodys(calm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The user must say to whom the truth belongs, and which person is meant."""
    assert main(["evaluate", str(calm / "person1")]) == 2
    assert "give --truth" in capsys.readouterr().err
    assert main(["export", str(calm), "--to", "bvh", "--out", str(calm / "all.bvh")]) == 2
    assert (
        f"{calm} holds the results of several people; give one of its folders, such as {calm / 'person1'}"
        in capsys.readouterr().err
    )


def test_an_interrupted_run_goes_on_with_the_same_bytes(sequence: Path, calm: Path, tmp_path: Path) -> None:
    """Stopped twice, once while a frame was written, each ends with the bytes of an undisturbed run."""
    out = tmp_path / "out"
    assert track(sequence, out, until=3) == 130
    assert track(sequence, out, until=3) == 2  # without --resume nothing is touched
    (out / LOG_FILE).write_bytes((out / LOG_FILE).read_bytes()[:-10])  # the last record is torn
    assert track(sequence, out, "--resume", until=5) == 130
    assert track(sequence, out, "--resume") == 0
    for person in ("person1", "person2"):
        assert (out / person / "track.npz").read_bytes() == (calm / person / "track.npz").read_bytes()
    assert not (out / LOG_FILE).exists()
    assert track(sequence, out, "--resume", until=0) == 0  # it is complete: nobody is asked


def test_where_nobody_is_nobody_was_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The first person has a folder nevertheless."""
    empty = in_a_room(frame_of(0, np.zeros((CAMERA.height, CAMERA.width))))
    sequence = write_open3d(tmp_path / "empty", np.repeat(empty.views[0].depth[None], 2, axis=0), CAMERA)
    assert track(sequence, tmp_path / "out") == 3
    assert "0 of up to 2 people were found" in capsys.readouterr().err


def test_more_than_there_are_leaves_no_empty_folders(sequence: Path, calm: Path, tmp_path: Path) -> None:
    """Of up to three, two are found, the same as before."""
    out = tmp_path / "three"
    assert track(sequence, out, "--people", "3") == 0
    assert sorted(each.name for each in out.iterdir()) == ["person1", "person2", "summary.json"]
    for person in ("person1", "person2"):
        ours, theirs = (gepf.load(folder / person).joint("pelvis") for folder in (out, calm))
        np.testing.assert_allclose(ours, theirs, atol=0.02)


KEY = "camera/depth"


def test_two_people_are_tracked_live(tmp_path: Path) -> None:
    """Both are found in the stream; each has a run, and one summary counts the frames."""
    where, out = f"tcp/127.0.0.1:{free_port()}", tmp_path / "run"
    results = [f"{KEY}/results/person{number}" for number in (1, 2)]
    with listening(where, *results) as heard, publishing(where, [KEY], until_tracked(heard, results), rest):
        options = ["--people", "2", "--particles", "6", "--listen", where, "--workers", "1", "--no-pictures"]
        ended = main(["track", f"zenoh:{KEY}", "--out", str(out), *options])
    assert ended in (0, 3)  # 3: the second person was found late
    summary = json.loads((out / "summary.json").read_text())
    assert summary["complete"] is True
    assert summary["frames_received"] >= summary["frames"] > 0
    assert [each["folder"] for each in summary["found"]] == ["person1", "person2"]
    assert not (out / LOG_FILE).exists()
    for person in ("person1", "person2"):
        assert json.loads((out / person / "summary.json").read_text())["status"]["tracked"] > 0


def rest(stop: threading.Event) -> None:
    """Between two images of a slow camera."""
    stop.wait(0.5)


def until_tracked(heard: Listener, results: list[str]) -> Iterator[dict[str, bytes]]:
    """The pair's images back and forth until both were published as tracked, and the end of the stream.

    However slow the machine is, there are images enough for all searches; an end in vain comes after minutes.
    """

    def tracked(key: str) -> bool:
        return any(msgspec.msgpack.decode(message)["status"] == "tracked" for message in heard.on(key))

    shown, _ = pair()
    last = FRAMES - 1
    for number in range(900):
        (image,) = shown.frames[last - abs(number % (2 * last) - last)].views
        yield {KEY: encode_live(replace(image, number=number, time_s=number / 2))}
        if all(map(tracked, results)):
            break
    yield {KEY: LIVE_END}
