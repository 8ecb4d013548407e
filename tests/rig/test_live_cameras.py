"""Live cameras of a rig over Zenoh: tracked together, also while one is away; recorded as a rig."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np

import gepf
from common.frame import DepthFrame
from common.protocol.frames import encode_live, encode_live_end
from common.transport.opening import open_worker
from coordinator.cli import main
from coordinator.results.track import read_track
from coordinator.sources import open_source
from tests.sources.test_live import CAMERA, Finder, at_work, plate, summary_of, until_recorded
from tests.support.processes.programs import in_thread

KEYS = {"front": "rig/front", "back": "rig/back"}
OFFSET_S = 0.5


def image(name: str, number: int) -> DepthFrame:
    """A plate at two metres whose depth differs from frame to frame, now by the camera's clock."""
    seen = np.zeros((CAMERA.height, CAMERA.width), dtype=np.uint16)
    seen[8:24, 8:24] = 2000 + number % 3
    time_s = time.monotonic() - (OFFSET_S if name == "back" else 0.0)
    return DepthFrame(number, time_s, seen, 1000.0, CAMERA)


def write_rig(folder: Path) -> Path:
    """The rig file of both cameras at one place."""
    listed = [
        {
            "name": name,
            "sequence": f"zenoh:{key}",
            "T_rig_camera": np.eye(4).tolist(),
            "time_offset_s": offset,
        }
        for (name, key), offset in zip(KEYS.items(), (0.0, OFFSET_S), strict=True)
    ]
    (folder / "rig.json").write_text(json.dumps({"cameras": listed}))
    return folder / "rig.json"


@contextmanager
def staged(
    where: str, shown: list[tuple[str, int | None]], rest: Callable[[threading.Event], object]
) -> Iterator[None]:
    """Two publishers that show images of these numbers in order, with a rest after each of the first camera.

    None ends a stream.
    """

    def publish(stop: threading.Event) -> None:
        with open_worker([where]) as one, open_worker([where]) as other:
            publishers = {"front": one.publish(KEYS["front"]), "back": other.publish(KEYS["back"])}
            while not all(each.has_subscriber for each in publishers.values()) and not stop.wait(0.01):
                pass
            for name, number in shown:
                message = encode_live_end() if number is None else encode_live(image(name, number))
                publishers[name].put_blocking(message)
                if name == "front" and number is not None:
                    rest(stop)
                    stop.wait(1 / 30)

    with in_thread(publish), at_work(where, Finder()):
        yield


def test_a_camera_that_leaves_and_comes_back_is_used_again(endpoint: str, tmp_path: Path) -> None:
    """It starts again with number 0; tracking goes on, and the recorded rig has what was used."""
    shown: list[tuple[str, int | None]] = []
    for n in range(24):
        if not 8 <= n < 14:
            shown.append(("back", n if n < 8 else n - 14))
        shown.append(("front", n))
    shown += [("back", None), ("front", None)]
    heard: list[bytes] = []

    def listen(stop: threading.Event) -> None:
        with open_worker([endpoint]) as bus:
            bus.subscribe("rig/person", lambda _, payload: heard.append(payload))
            stop.wait()

    options = {"--workers": 0, "--listen": endpoint, "--idle-timeout": 60, "--particles": 20}
    options |= {"--out": tmp_path / "run", "--record": tmp_path / "kept", "--publish": "rig/person"}
    given = [str(part) for pair in (options | plate(tmp_path)).items() for part in pair]
    with staged(endpoint, shown, until_recorded(tmp_path / "run")), in_thread(listen):
        assert main(["track", str(write_rig(tmp_path)), *given, "--no-pictures"]) == 0
    track, summary = read_track(tmp_path / "run"), summary_of(tmp_path / "run")
    assert np.all(np.diff(track.frame) > 0)
    assert np.all(np.diff(track.time_s) > 0.0)
    results = [msgspec.msgpack.decode(payload) for payload in heard]
    assert [each["frame"] for each in results if each["kind"] == "estimate"][-1] == track.frame[-1]
    assert summary["frames_received"] == 24 + 18
    assert summary["cameras"]["front"]["frames_shown"] > 12
    (back,) = open_source(tmp_path / "kept" / "rig.json").others
    kept = list(back)
    assert kept[-1].time_s - kept[0].time_s > 14 / 30
    assert np.all(np.diff([frame.number for frame in kept]) > 0)


def test_the_library_follows_a_live_rig(endpoint: str, tmp_path: Path) -> None:
    """`gepf.live` of a rig file gives the frames of both cameras together."""
    shown: list[tuple[str, int | None]] = [(name, n) for n in range(9) for name in ("back", "front")]
    shown += [("back", None), ("front", None)]
    arrived = threading.Semaphore(0)
    frames = []
    with staged(endpoint, shown, lambda _: arrived.acquire(timeout=60.0)):
        for frame in gepf.live(write_rig(tmp_path), listen=endpoint, idle_timeout=60.0):
            frames.append(frame)
            arrived.release()
    assert frames[-1].number >= 8
    assert {view.camera for frame in frames for view in frame.views} == {"front", "back"}
    assert any(len(frame.views) == 2 for frame in frames)
