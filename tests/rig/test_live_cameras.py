"""Live cameras of a rig over Zenoh: tracked together, also while one is away; recorded as a rig."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np

import gepf
from gepf.common.protocol.frames import LIVE_END, encode_live
from gepf.coordinator.cli import main
from gepf.coordinator.results.track import read_track
from gepf.coordinator.sources import open_source
from gepf.coordinator.sources.rig import RigCamera, write_rig
from tests.support import live

KEYS = {"front": "rig/front", "back": "rig/back"}
OFFSET_S = 0.5


def image(name: str, number: int) -> bytes:
    """A plate at two metres whose depth differs from frame to frame, now by the camera's clock."""
    time_s = time.monotonic() - (OFFSET_S if name == "back" else 0.0)
    return encode_live(live.plate_image(number, 2000 + number % 3, time_s))


def rig_of(folder: Path) -> Path:
    """The rig file of both cameras at one place."""
    late = {"front": 0.0, "back": OFFSET_S}
    cameras = [RigCamera(name, f"zenoh:{key}", np.eye(4).tolist(), late[name]) for name, key in KEYS.items()]
    write_rig(folder / "rig.json", cameras)
    return folder / "rig.json"


@contextmanager
def staged(where: str, shown: Iterable[Mapping[str, int]], rest: live.Rest) -> Iterator[None]:
    """Publishers that show images of these numbers by camera, with rests between, and end."""

    def pause(stop: threading.Event) -> None:
        rest(stop)
        stop.wait(1 / 30)

    def steps() -> Iterator[dict[str, bytes]]:
        for numbers in shown:
            yield {KEYS[name]: image(name, number) for name, number in numbers.items()}
        yield dict.fromkeys(KEYS.values(), LIVE_END)

    with live.publishing(where, KEYS.values(), steps(), pause), live.at_work(where):
        yield


def test_a_camera_that_leaves_and_comes_back_is_used_again(endpoint: str, tmp_path: Path) -> None:
    """It starts again with number 0; tracking goes on, and the recorded rig has what was used."""
    numbers = {n: n if n < 8 else n - 14 for n in range(24) if not 8 <= n < 14}
    shown = [({"back": numbers[n]} if n in numbers else {}) | {"front": n} for n in range(24)]
    options = {"listen": endpoint, "particles": 20, "record": tmp_path / "kept", "publish": "rig/person"}
    command = live.tracking(str(rig_of(tmp_path)), tmp_path / "run", "--no-pictures", **options)
    with (
        staged(endpoint, shown, live.until_recorded(tmp_path / "run")),
        live.listening(endpoint, "rig/person") as listener,
    ):
        assert main(command) == 0
    track, summary = read_track(tmp_path / "run"), live.summary_of(tmp_path / "run")
    assert np.all(np.diff(track.frame) > 0)
    assert np.all(np.diff(track.time_s) > 0.0)
    results = [msgspec.msgpack.decode(payload) for _, _, payload in listener.heard]
    assert [each["frame"] for each in results if each["kind"] == "estimate"][-1] == track.frame[-1]
    assert summary["frames_received"] == 24 + 18
    assert summary["cameras"]["front"]["frames_shown"] > 12
    _, back = open_source(tmp_path / "kept" / "rig.json").views
    kept = list(back)
    assert kept[-1].time_s - kept[0].time_s > 14 / 30
    assert np.all(np.diff([frame.number for frame in kept]) > 0)


def test_the_library_follows_a_live_rig(endpoint: str, tmp_path: Path) -> None:
    """`gepf.live` of a rig file gives the frames of both cameras together."""
    arrived, frames = threading.Semaphore(0), []
    shown = ({"back": n, "front": n} for n in range(9))
    with staged(endpoint, shown, live.until_released(arrived)):
        for frame in gepf.live(rig_of(tmp_path), listen=endpoint, idle_timeout=60.0):
            frames.append(frame)
            arrived.release()
    assert frames[-1].number >= 8
    assert {view.camera for frame in frames for view in frame.views} == {"front", "back"}
    assert any(len(frame.views) == 2 for frame in frames)
