"""Frames of a live stream: the newest is yielded; frames that do not fit are rejected and counted."""

from __future__ import annotations

import threading
from io import BytesIO
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.common.frame import Frame, View
from gepf.common.protocol.frames import LIVE_END, encode_colour, encode_live
from gepf.coordinator.sources.live import COUNTED, LiveFrames, from_first_seen
from gepf.coordinator.sources.live_stream import LiveCamera, live_key
from tests.support.walls import CAMERA, LONG, WIDE, image

KEY = "camera/depth"


def counted(**counts: int) -> dict[str, int]:
    """All counts; those not given are zero."""
    return dict.fromkeys(COUNTED, 0) | counts


def opened(notice: float = 60.0, idle: float | None = None) -> tuple[LiveFrames, list[str]]:
    """Live frames, and what is reported."""
    reports: list[str] = []
    return LiveFrames([LiveCamera(KEY)], reports.append, notice, idle), reports


def test_the_newest_frame_wins_and_the_others_are_counted() -> None:
    """Each iteration yields the frame that came last, each once; the end comes after the last frame."""
    frames, reports = opened()
    numbers = iter(frames)
    for number in (0, 1, 2):
        frames.receive(encode_live(image(number)))
    assert next(numbers).number == 2
    frames.receive(encode_live(image(3)))
    assert next(numbers).number == 3
    for message in (encode_live(image(4)), LIVE_END, encode_live(image(5))):
        frames.receive(message)
    assert [frame.number for frame in numbers] == [4]
    assert frames.counts == counted(received=5, skipped=2)
    assert reports == []


def test_colour_joins_its_frame_if_it_has_come() -> None:
    """By number; late, missing and damaged colour leaves the frame as it is, and delays none."""
    frames, reports = opened()
    numbers, red = iter(frames), BytesIO()
    Image.new("RGB", (CAMERA.width, CAMERA.height), (200, 0, 0)).save(red, "JPEG")
    for number, before in ((0, red.getvalue()), (1, None), (2, b"\xff\xd8 damaged"), (4, red.getvalue())):
        if before is not None:
            frames.receive_colour(encode_colour(number, before))
        frames.receive(encode_live(image(number)))
        (taken,) = next(numbers).views
        assert np.array_equal(taken.depth, image(number).depth)
        assert (taken.colours is not None) == (number in (0, 4))
        frames.receive_colour(encode_colour(number, red.getvalue()))  # too late
    assert taken.colours is not None
    assert taken.colours.shape == (CAMERA.height, CAMERA.width, 3)
    frames.receive_colour(b"nonsense")
    assert not reports


def test_malformed_messages_are_counted_and_reported_once() -> None:
    """They do not displace a frame that waits, and do not end the stream."""
    frames, reports = opened()
    frames.receive(encode_live(image(7)))
    other_version = encode_live(image(8)).replace(b"version\x01", b"version\x09")
    for malformed in (b"", b"\xc1" * 100, other_version):
        frames.receive(malformed)
    frames.receive(LIVE_END)
    assert [frame.number for frame in frames] == [7]
    assert frames.counts == counted(received=1, malformed=3)
    assert reports == [
        f"a message on {KEY} is malformed: not a live-frame or live-end message: Input data was truncated"
    ]


@pytest.mark.parametrize(
    ("odd", "line"),
    [
        (image(3, camera=WIDE), "is 6x3, those before 4x3"),
        (image(3, camera=LONG), "has other intrinsics"),
        (image(3, depth_scale=5000.0), "has 5000 units per metre"),
        (image(2), "is number 2 of 0.0666667 s"),
        (image(3, time_s=0.01), "is number 3 of 0.01 s"),
        (image(1, time_s=9.0), "is number 1 of 9 s"),
    ],
)
def test_an_odd_frame_is_rejected(odd: View, line: str) -> None:
    """It is counted, its cause is reported the first time, and the stream goes on."""
    frames, reports = opened()
    numbers = iter(frames)
    frames.receive(encode_live(image(2)))
    assert next(numbers).number == 2
    for message in (odd, odd, image(4), odd, image(5)):
        frames.receive(encode_live(message))
    assert next(numbers).number == 5
    assert frames.stream == 0
    assert frames.counts == counted(received=6, skipped=1, rejected=3)
    assert len(reports) == 1
    assert reports[0].startswith(f"a frame on {KEY} {line}")


@pytest.mark.parametrize(
    "other", [{"camera": WIDE}, {"depth_scale": 5000.0}, {}], ids=["camera", "scale", "start"]
)
def test_frames_that_fit_each_other_are_a_new_stream(other: dict[str, object]) -> None:
    """A camera that changes its mode, or a publisher that starts again from 0: tracking starts anew."""
    frames, reports = opened()
    numbers = iter(frames)
    for number in range(100, 103):
        frames.receive(encode_live(image(number)))
    for number in range(5):
        assert frames.stream == 0
        frames.receive(encode_live(image(number, **other)))  # type: ignore[arg-type]
    frame = next(numbers)
    assert (frames.stream, frame.number) == (1, 4)
    assert frames.counts["rejected"] == 4
    assert len(reports) == 2
    assert reports[1].endswith("tracking starts again")
    frames.receive(encode_live(image(103)))
    frames.receive(encode_live(image(5, **other)))  # type: ignore[arg-type]
    assert next(numbers).number == (5 if other else 103)
    assert frames.stream == 1


def test_two_cameras_on_one_key_leave_the_first_one_tracked() -> None:
    """If both start again, tracking continues with one of them."""
    frames, _ = opened()
    numbers = iter(frames)
    yielded: list[tuple[int, Intrinsics]] = []
    for _ in range(2):
        for number in range(40):
            frames.receive(encode_live(image(number, camera=WIDE if number % 2 else CAMERA)))
            counts = frames.counts
            if counts["received"] - counts["skipped"] - counts["rejected"] > len(yielded):
                yielded.append((frames.stream, next(numbers).views[0].intrinsics))
    assert [camera for _, camera in yielded] == [CAMERA] * (20 + 16)
    assert frames.stream == 1


runs = st.lists(
    st.tuples(
        st.sampled_from([CAMERA, WIDE, LONG]),
        st.sampled_from([1000.0, 5000.0]),
        st.integers(0, 30),  # first number
        st.floats(0.0, 30.0),  # first time
        st.integers(-1, 3),  # from number to number
        st.sampled_from([-1.0, 0.0, 0.1, 1.0]),  # from time to time
        st.integers(1, 10),  # frames
    ),
    max_size=12,
)


@given(runs, st.data())
def test_a_stream_never_changes_silently(
    runs: list[tuple[Intrinsics, float, int, float, int, float, int]], data: st.DataObject
) -> None:
    """Law: frames yielded with one `stream` have one camera and scale; their numbers and times increase."""
    frames, _ = opened()
    numbers = iter(frames)
    yielded: list[tuple[int, View]] = []

    def take() -> None:
        counts = frames.counts
        waiting = counts["received"] - counts["skipped"] - counts["rejected"] - len(yielded)
        assert waiting in (0, 1)
        if waiting:
            (view,) = next(numbers).views
            yielded.append((frames.stream, view))

    for camera, scale, number, time_s, step, interval, length in runs:
        for k in range(length):
            frames.receive(
                encode_live(image(max(0, number + k * step), time_s + k * interval, camera, scale))
            )
            if data.draw(st.booleans()):
                take()
        if length >= 8 and step > 0 and interval > 0.0:
            take()
            assert yielded[-1][1].intrinsics == camera
            assert yielded[-1][1].time_s == time_s + (length - 1) * interval
    for (stream, before), (next_stream, after) in pairwise(yielded):
        if stream == next_stream:
            assert (before.intrinsics, before.depth_scale) == (after.intrinsics, after.depth_scale)
            assert before.depth.shape == after.depth.shape
            assert before.number < after.number
            assert before.time_s < after.time_s
        else:
            assert stream < next_stream


def test_a_frame_is_waited_for_and_silence_is_reported() -> None:
    """An iteration that begins too early gets the frame when it comes; after a while silence is reported."""
    frames, reports = opened(notice=0.05)
    threading.Timer(0.2, lambda: frames.receive(encode_live(image(1)))).start()
    assert next(iter(frames)).number == 1
    assert reports == [f"no frame comes on {KEY}; waiting for one"]


def test_a_stream_whose_publisher_died_is_over_after_a_while() -> None:
    """The frame that waits is still given; then silence ends it, with a line. A frame restarts the clock."""
    frames, reports = opened(idle=0.3)
    frames.receive(encode_live(image(1)))
    numbers = iter(frames)
    assert next(numbers).number == 1
    threading.Timer(0.1, lambda: frames.receive(encode_live(image(2)))).start()
    assert [frame.number for frame in numbers] == [2]
    assert reports == [f"no frame came on {KEY} for 0.3 s; ending"]


def test_nothing_starts_from_frames_without_depth() -> None:
    """Empty frames before the first with depth are passed over, which is reported once; later ones count."""
    images = [image(0, depth=0), image(1, depth=0), image(2), image(3, depth=0)]
    reports: list[str] = []
    assert [frame.number for frame in from_first_seen(map(Frame.of, images), reports.append)] == [2, 3]
    assert reports == ["frames come, but without depth; waiting for one with depth"]


@pytest.mark.parametrize("key", ["", "/a", "../a", "a/*", "a?b", "a b", "@adv/x", "x" * 99])
def test_a_key_names_one_place(key: str) -> None:
    """Patterns and malformed keys are refused in a line that shows a good one."""
    with pytest.raises(InputError, match="such as camera/depth"):
        live_key(Path("zenoh:" + key))


class Together(threading.Condition):
    """A condition that two threads leave together, if both come."""

    barrier = threading.Barrier(2)

    def __exit__(self, *raised: object) -> None:
        """Release the lock, and wait for the other thread."""
        super().__exit__(*raised)  # type: ignore[arg-type]
        if threading.current_thread() is not threading.main_thread():
            self.barrier.wait(300.0)


def test_malformed_messages_of_two_cameras_at_once_are_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both are counted before either of their threads goes on."""
    reports: list[str] = []
    with monkeypatch.context() as patched:
        patched.setattr(threading, "Condition", Together)
        frames = LiveFrames([LiveCamera(f"{KEY}/{name}", name) for name in ("a", "b")], reports.append)
    threads = [threading.Thread(target=frames.receive, args=(b"?",), kwargs={"place": n}) for n in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(reports) == 1
    assert frames.counts == counted(malformed=2)
