"""Live input: published frames are tracked as they come, and skipped ones are counted."""

from __future__ import annotations

import signal
import socket
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain, count, takewhile
from pathlib import Path

import msgspec
import numpy as np
import pytest

from gepf.common.protocol.frames import LIVE_END, encode_live
from gepf.common.transport.opening import open_coordinator
from gepf.coordinator.cli import main
from gepf.coordinator.results.track import read_track
from gepf.coordinator.sources import open_source
from tests.support.live import (
    CAMERA,
    KEY,
    Finder,
    Listener,
    Rest,
    at_work,
    listening,
    plate_image,
    publishing,
    recorded_frames,
    recording,  # noqa: F401 a fixture
    summary_of,
    tracking,
    until_recorded,
)
from tests.support.processes.programs import GEPF, started, wait_until
from tests.support.processes.warm_processes import gepf, start

TRIES = 5  # at being on time, which a machine that is busy may miss


@contextmanager
def staged(where: str, frames: Iterable[int], rest: Rest, worker: Finder) -> Iterator[None]:
    """A worker, and a camera that shows frames when there is a listener, and then the end."""
    steps = ({KEY: message} for message in chain(map(encode_live, map(plate_image, frames)), [LIVE_END]))
    with publishing(where, [KEY], steps, rest), at_work(where, worker):
        yield


def track_live(where: str, out: Path, *options: str) -> int:
    """`gepf track` of the plate in the stream."""
    return main([*tracking(f"zenoh:{KEY}", out, listen=where, particles=20), *options])


def test_a_stream_is_tracked_to_its_end(endpoint: str, tmp_path: Path) -> None:
    """Every frame of a slow stream is in the results under its own number and time, and in the recording."""
    with staged(endpoint, (10, 11, 15), until_recorded(tmp_path / "run"), Finder()):
        assert track_live(endpoint, tmp_path / "run", "--record", str(tmp_path / "kept")) == 0
    kept = [*open_source(tmp_path / "kept")]
    assert [frame.number for frame in kept] == [10, 11, 15]
    np.testing.assert_allclose([frame.time_s for frame in kept], np.array([0, 1, 5]) / 30)
    assert all(np.array_equal(frame.views[0].depth, plate_image(0).depth) for frame in kept)
    assert (kept[0].views[0].intrinsics, kept[0].views[0].depth_scale) == (CAMERA, 1000.0)
    track, summary = read_track(tmp_path / "run"), summary_of(tmp_path / "run")
    assert track.frame.tolist() == [10, 11, 15]
    np.testing.assert_allclose(track.time_s, np.array([10, 11, 15]) / 30)
    counts = {name: summary[f"frames_{name}"] for name in ("received", "skipped", "malformed", "unwritten")}
    assert counts == {"received": 3, "skipped": 0, "malformed": 0, "unwritten": 0}
    assert (summary["frames"], summary["complete"]) == (3, True)
    assert (tmp_path / "run" / "hypotheses.png").exists()


def test_a_stream_that_is_too_fast_loses_the_older_frames(endpoint: str, tmp_path: Path) -> None:
    """A worker needs 50 ms a particle: of frames every 20 ms most are skipped, counted, the last one kept."""
    with staged(endpoint, range(30), lambda stop: stop.wait(0.02), Finder(0.05)):
        assert track_live(endpoint, tmp_path / "run") == 0
    track, summary = read_track(tmp_path / "run"), summary_of(tmp_path / "run")
    assert summary["frames_received"] == 30
    assert summary["frames_skipped"] == 30 - len(track.frame) > 10
    assert track.frame[-1] == 29
    assert np.all(np.diff(track.frame) > 0)


def test_results_are_heard_while_the_run_goes_on(endpoint: str, tmp_path: Path) -> None:
    """A subscriber gets every tracked frame while others come, and the end, in both formats."""
    for form, option in (("msgpack", ()), ("json", ("--publish-json",))):
        out = tmp_path / form / "run"
        out.parent.mkdir()
        with (
            listening(endpoint, "robot/person") as listener,
            staged(endpoint, until_heard(listener, 20), until_more_is_heard(listener), Finder()),
        ):
            assert track_live(endpoint, out, "--publish", "robot/person", *option) == 0
            wait_until(lambda: b"estimates-end" in listener.heard[-1][2])
        decode = msgspec.json.decode if form == "json" else msgspec.msgpack.decode
        *told, end = [decode(payload) for _, _, payload in listener.heard]
        track = read_track(out)
        assert len(told) >= 20
        assert [message["frame"] for message in told] == track.frame[-len(told) :].tolist()
        assert end == {"kind": "estimates-end", "version": 1}
        assert np.array_equal([list(message["pose"].values()) for message in told], track.pose[-len(told) :])
        assert list(told[0]["angles"]) == list(track.angle_names or ())


def until_heard(listener: Listener, messages: int) -> Iterator[int]:
    """Numbers of frames, until so many messages have been heard."""
    return takewhile(lambda _: len(listener.heard) < messages, count())


def until_more_is_heard(listener: Listener) -> Rest:
    """A rest until another message has been heard; before the first, a listener may not be known yet."""
    heard = 0

    def rest(stop: threading.Event) -> None:
        nonlocal heard
        while len(listener.heard) == heard and not stop.wait(0.01 if heard else 0.2) and heard:
            pass
        heard = len(listener.heard)

    return rest


@pytest.mark.parametrize("first", ["publisher", pytest.param("tracker", marks=pytest.mark.slow)])
def test_publisher_and_tracker_start_in_either_order(
    endpoint: str, recording: Path, tmp_path: Path, first: str
) -> None:
    """The publisher waits until there is a listener, the tracker until there are frames."""
    play = ["publish", str(recording), "--key", KEY, "--connect", endpoint, "--rate", "30", "--frames", "0:6"]
    command = tracking(f"zenoh:{KEY}", tmp_path / "run", listen=endpoint)
    commands = {"publisher": play, "tracker": [*command, "--no-pictures"]}
    second = "tracker" if first == "publisher" else "publisher"
    with at_work(endpoint):
        one = start(gepf, *commands[first], log=tmp_path / "log")
        one.join(1.0)
        assert one.is_alive()
        other = start(gepf, *commands[second], log=tmp_path / "log")
        for process in (one, other):
            process.join(300.0)
            assert process.exitcode == 0, (tmp_path / "log").read_text()
    track, summary = read_track(tmp_path / "run"), summary_of(tmp_path / "run")
    assert track.frame[-1] == 5
    assert summary["frames_received"] == summary["frames_skipped"] + len(track.frame)


@pytest.mark.slow
@pytest.mark.parametrize("publisher_dies", [True, False])
def test_a_run_whose_stream_breaks_off_is_complete(
    endpoint: str, recording: Path, tmp_path: Path, *, publisher_dies: bool
) -> None:
    """A killed publisher sends no end, so a timeout ends the run; Ctrl-C at the tracker ends it at once."""
    track = tracking(f"zenoh:{KEY}", tmp_path / "run", "--no-pictures", listen=endpoint, idle_timeout=2)
    with at_work(endpoint), started(*track, command=GEPF) as tracker:
        play = ["publish", str(recording), "--key", KEY, "--connect", endpoint, "--rate", "2"]
        with started(*play, command=GEPF) as publisher:
            log = tmp_path / "run" / "live.mcap"
            wait_until(lambda: log.exists() and recorded_frames(tmp_path / "run") > 2, 300.0)
            publisher.kill() if publisher_dies else tracker.send_signal(signal.SIGINT)
            assert tracker.wait(300.0) == 0
        assert tracker.stderr is not None
        assert (f"no frame came on {KEY} for 2 s; ending\n" in tracker.stderr.read()) == publisher_dies
    summary = summary_of(tmp_path / "run")
    assert summary["complete"]
    assert 0 < summary["frames"] < 40
    assert not log.exists()


@pytest.mark.slow
def test_a_publisher_names_an_endpoint_without_an_answer(endpoint: str, recording: Path) -> None:
    """The line names endpoint and key; it keeps trying."""
    play = ["publish", str(recording), "--key", KEY, "--connect", endpoint]
    with started(*play, command=GEPF) as publisher:
        assert publisher.stderr is not None
        assert publisher.stderr.readline() == (
            f"no answer at {endpoint} yet; waiting for a subscriber of {KEY}\n"
        )
        assert publisher.poll() is None


@pytest.mark.slow
def test_a_recording_with_gaps_is_published_in_real_time(endpoint: str, recording: Path) -> None:
    """Frames that are missing are waited for; --rate makes the time between any two the same."""
    for number in (*range(2, 20), *range(21, 40)):
        (recording / "depth" / f"{number:06d}.png").unlink()
    for options, gaps in (((), [1 / 30, 19 / 30]), (("--rate", "5"), [0.2, 0.2])):
        times = (arrivals(endpoint, recording, *options) for _ in range(TRIES))
        assert any(np.diff(came)[:2] == pytest.approx(gaps, abs=0.15) for came in times)


def arrivals(endpoint: str, recording: Path, *options: str) -> list[float]:
    """When the three frames of a recording that is published, and its end, come; seconds."""
    with listening(endpoint, KEY, opened=open_coordinator) as listener:
        listener.ready.wait(300.0)
        play = ["publish", str(recording), "--key", KEY, "--connect", endpoint, *options]
        with started(*play, command=GEPF) as publisher:
            assert publisher.wait(300.0) == 0
    assert len(listener.heard) == 4
    return [when for _, when, _ in listener.heard]


@pytest.mark.slow
def test_an_interrupt_before_the_first_frame_leaves_nothing(endpoint: str, tmp_path: Path) -> None:
    """An interrupt while waiting gives exit code 130, as in every run, and no folder."""
    command = tracking(f"zenoh:{KEY}", tmp_path / "run", listen=endpoint)
    with at_work(endpoint), started(*command, command=GEPF) as tracker:
        assert tracker.stderr is not None
        assert any(line.startswith("listening on") for line in tracker.stderr)
        tracker.send_signal(signal.SIGINT)
        assert tracker.wait(300.0) == 130
    assert not (tmp_path / "run").exists()


def test_a_port_in_use_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two runs cannot listen at one place: exit code 2, and the line says which port to change."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        assert main(tracking(f"zenoh:{KEY}", tmp_path / "run", listen=endpoint)) == 2
    told = capsys.readouterr().err
    assert f"gepf: {endpoint} is in use by another program; end it, or choose another port" in told
    assert not (tmp_path / "run").exists()
