"""Frames of several live cameras: which belong together, and what a camera that fails changes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gepf.common.errors import InputError
from gepf.common.frame import Frame
from gepf.coordinator.sources.live import LiveRig
from gepf.coordinator.sources.live_stream import LiveCamera
from gepf.coordinator.sources.rig import live_cameras
from tests.support.walls import WIDE, image

Sent = tuple[float, str, int, float]  # reception, camera, number, time by the camera's clock


def cameras(*offsets: float) -> list[LiveCamera]:
    """Cameras a, b, ... with these time offsets."""
    names = "abc"[: len(offsets)]
    return [
        LiveCamera(f"rig/{name}", name, np.eye(4), each) for name, each in zip(names, offsets, strict=True)
    ]


def sent(
    name: str, first: float, count: int, rate: float = 30.0, late: float = 0.0, clock: float = 0.0
) -> list[Sent]:
    """Frames at a rate from a time on, each received a while later, with another clock."""
    times = [first + n / rate for n in range(count)]
    return [(time_s + late, name, n, time_s + clock) for n, time_s in enumerate(times)]


def play(rig: LiveRig, events: list[Sent]) -> Iterator[Frame]:
    """The frames that a tracker takes that is always idle."""
    for now, name, number, time_s in sorted(events):
        rig.accept(image(number, time_s, depth=2000 + number), now, "abc".index(name))
        while (frame := rig.take(now)) is not None:
            yield frame


def played(offsets: tuple[float, ...], *events: list[Sent]) -> list[Frame]:
    """All frames that are taken."""
    return list(play(LiveRig(cameras(*offsets)), [each for some in events for each in some]))


def test_each_frame_of_the_first_camera_has_the_newest_of_the_others() -> None:
    """Unsynchronised, at one rate: from the third frame on, each with one of the other's, used once."""
    frames = played((0.0, 0.0), sent("a", 0.0, 20), sent("b", 0.012, 20))
    assert [frame.views[0].camera for frame in frames] == ["a"] * 20
    assert [frame.number for frame in frames] == list(range(20))
    used = [frame.views[1] for frame in frames[3:]]
    assert [other.number for other in used] == list(range(2, 19))
    for frame, other in zip(frames[3:], used, strict=True):
        assert other.camera == "b"
        assert -1 / 30 < other.time_s - frame.time_s < 0.0


@pytest.mark.parametrize(("rate", "share"), [(10.0, 1 / 3), (30.0, 1.0), (90.0, 1.0)])
def test_rates_may_differ(rate: float, share: float) -> None:
    """A slow camera adds to some frames, of a fast one each frame gets the newest; none is used twice."""
    frames = played((0.0, 0.0), sent("a", 0.0, 60), sent("b", 0.004, round(2 * rate), rate))
    assert len(frames) == 60
    used = [view.number for frame in frames for view in frame.views[1:]]
    assert len(used) == len(set(used)) == pytest.approx(60 * share, abs=5)


def test_another_clock_is_moved_by_the_offset() -> None:
    """Times are the rig's: the camera's own plus time_offset_s."""
    frames = played((0.25, -0.125), sent("a", 0.0, 9, clock=-0.25), sent("b", 0.01, 9, clock=0.125))
    assert [frame.time_s for frame in frames] == pytest.approx([n / 30 for n in range(9)])
    assert [frame.views[1].time_s for frame in frames[3:]] == pytest.approx(
        [0.01 + n / 30 for n in range(2, 8)]
    )


def test_a_late_camera_stops_nobody() -> None:
    """Its frames come 0.2 s late: they are left out, and every frame of the first is taken when it comes."""
    rig, taken = LiveRig(cameras(0.0, 0.0)), 0
    for now, name, number, time_s in sorted(sent("a", 0.0, 30) + sent("b", 0.0, 30, late=0.2)):
        rig.accept(image(number, time_s), now, "ab".index(name))
        frame = rig.take(now)
        assert (frame is not None) == (name == "a")
        taken += frame is not None and len(frame.views) == 1
    assert taken == 30


def test_when_the_first_camera_is_silent_the_next_one_gives_the_time() -> None:
    """Numbers and times go on; when the first is back, it leads again."""
    first = [each for each in sent("a", 0.0, 60) if not 0.5 < each[0] < 1.2]
    frames = played((0.0, 0.0), first, sent("b", 0.01, 60))
    leads = [frame.views[0].camera for frame in frames]
    assert leads.count("b") == pytest.approx(0.6 * 30, abs=2)
    after = leads[::-1].index("b")
    assert leads == ["a"] * leads.index("b") + ["b"] * leads.count("b") + ["a"] * after
    assert np.all(np.diff([frame.number for frame in frames]) > 0)
    assert np.all(np.diff([frame.time_s for frame in frames]) > 0.0)
    assert np.diff([frame.time_s for frame in frames]).max() < 0.15


def test_a_camera_that_never_sends_is_not_waited_for() -> None:
    """The second camera leads from its first frame on, until the first begins; one line names the first."""
    frames = played((0.0, 0.0), sent("a", 1.0, 20), sent("b", 0.0, 50))
    assert [frame.views[0].camera for frame in frames[:30]] == ["b"] * 30
    assert [frame.views[0].camera for frame in frames[32:]] == ["a"] * len(frames[32:])
    rig, events = LiveRig(cameras(0.0, 0.0)), sent("a", 8.0, 20) + sent("b", 0.0, 260)
    said = [rig.accept(image(n, time_s), now, "ab".index(name)) for now, name, n, time_s in sorted(events)]
    assert said[:150] == [None] * 150
    assert said[150] == "no frame has come from camera a on rig/a; is its publisher running, with this key?"
    assert not any(said[151:])


@pytest.mark.parametrize("name", ["a", "b"])
def test_a_restarted_camera_goes_on_in_the_rigs_time(name: str) -> None:
    """Its numbers and clock begin again at 0: both continue, the clock by reception."""
    rig, other = LiveRig(cameras(0.0, 0.0)), "b" if name == "a" else "a"
    again = sent(name, 2.0, 30, late=0.005, clock=-2.0)
    frames = list(play(rig, sent(name, 0.0, 30, late=0.005) + sent(other, 0.01, 90, late=0.005) + again))
    assert rig.begun == 0
    last = frames[-5:]
    assert all(len(frame.views) == 2 for frame in last)
    for frame in last:
        assert {view.camera for view in frame.views} == {"a", "b"}
        assert abs(frame.views[1].time_s - frame.time_s) < 1 / 30
    assert np.all(np.diff([frame.number for frame in frames]) > 0)
    assert np.all(np.diff([frame.time_s for frame in frames]) > 0.0)


def test_if_no_other_camera_lives_tracking_starts_again() -> None:
    """Also if a camera has another size than before."""
    rig = LiveRig(cameras(0.0, 0.0))
    list(play(rig, sent("a", 0.0, 30) + sent("b", 0.0, 30) + sent("a", 9.0, 30, clock=-9.0)))
    assert rig.begun == 1
    for n in range(10):
        rig.accept(replace(image(n, 10.0 + n / 30, WIDE)), 10.0 + n / 30, 1)
    assert rig.begun == 2


def write(folder: Path, *sequences: str) -> Path:
    """A rig file of cameras with these sequences."""
    at = np.eye(4).tolist()
    listed = [{"name": f"camera{n}", "sequence": s, "T_rig_camera": at} for n, s in enumerate(sequences)]
    (folder / "rig.json").write_text(json.dumps({"cameras": listed}))
    return folder / "rig.json"


def test_a_rig_file_lists_keys(tmp_path: Path) -> None:
    """All cameras are live, or none; a key is listed once and names one place."""
    assert [camera.key for camera in live_cameras(write(tmp_path, "zenoh:rig/a", "zenoh:rig/b"))] == [
        "rig/a",
        "rig/b",
    ]
    assert live_cameras(write(tmp_path, "a", "b")) == ()
    for sequences, said in (
        (("zenoh:a", "b"), "'camera1' is a recording, but others are live"),
        (("zenoh:a", "zenoh:a"), "lists zenoh:a twice, as 'camera0' and 'camera1'"),
        (("zenoh:a", "realsense:1"), "its vendor's SDK; use gepf publish realsense:1 --key"),
        (("zenoh:a", "zenoh:b/*"), "key 'b/\\*' cannot be used"),
        (("zenoh:a", "ros2:/b"), "cameras of ROS 2 are tracked alone; give ros2:/TOPIC"),
    ):
        with pytest.raises(InputError, match=said):
            live_cameras(write(tmp_path, *sequences))
