"""Live input: depth frames that another process publishes; docs/live.md describes the messages."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from common.errors import ProtocolError
from common.frame import DepthFrame
from common.protocol.frames import decode_live
from common.protocol.keys import check_stream
from common.recent import FRAMES_KEPT, put_recent
from coordinator.stopwatch import NOTICE_S

SCHEME = "zenoh:"
NEW_STREAM_FRAMES = 5  # that fit each other


def live_key(sequence: Path) -> str | None:
    """The key of `zenoh:KEY`; None for recordings. InputError if the key is invalid."""
    text = str(sequence)
    return check_stream(text.removeprefix(SCHEME)) if text.startswith(SCHEME) else None


COUNTED = ("received", "skipped", "rejected", "malformed")
"""Received frames are tracked, skipped because a newer one came, or rejected if they do not fit the stream.
Malformed messages are not frames."""


class LiveFrames:
    """The newest frame at each request; iterates until the stream ends.

    All frames of a stream have one size, camera and depth scale, and their numbers and times increase. A
    frame that does not fit is rejected and counted. If `NEW_STREAM_FRAMES` frames fit each other, and none
    arrives that fits the stream, they start a new stream: the publisher was restarted, or there is another
    camera. `stream` is the number of the stream. It changes immediately before the first frame of a new
    stream is yielded, and tracking must start again with that frame.

    Messages are received on a thread of the bus. `report` is called with a message for the user when the
    stream is silent, when a new one starts, and at the first rejected frame of each cause. The stream also
    ends after `idle` silent seconds; None to wait for ever.
    """

    def __init__(
        self, key: str, report: Callable[[str], None], notice: float = NOTICE_S, idle: float | None = None
    ) -> None:
        self.stream = 0  # of the last yielded frame
        self._key = key
        self._idle = math.inf if idle is None else idle
        self._notice = notice
        self._report = report
        self._changed = threading.Condition()
        self._newest: tuple[int, DepthFrame, float] | None = None  # stream, frame to be yielded, reception
        self._received: dict[int, float] = {}  # when frames were received, by number, the last yielded ones
        self._last: DepthFrame | None = None  # the last accepted frame
        self._last_stream = 0
        self._period_s = math.inf
        self._rejected: deque[DepthFrame] = deque(maxlen=2 * NEW_STREAM_FRAMES)  # since then
        self._ended = False
        self._counts = dict.fromkeys(COUNTED, 0)
        self._reported: set[str] = set()  # causes of rejected frames

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages of each kind in `COUNTED` so far."""
        with self._changed:
            return self._counts.copy()

    @property
    def is_ready(self) -> bool:
        """Whether the next frame waits, or the stream has ended."""
        with self._changed:
            return self._is_ready()

    @property
    def period_s(self) -> float:
        """Time in seconds between the last two frames of the stream; infinite if there are not two."""
        with self._changed:
            return self._period_s

    def wait(self, seconds: float) -> None:
        """Wait for the next frame or the end of the stream, at most so long."""
        with self._changed:
            self._wait(seconds)

    def receive(self, payload: bytes) -> None:
        """Receive a message; an older frame that is still waiting is skipped."""
        received = time.monotonic()
        try:
            frame = decode_live(payload)
        except ProtocolError as error:
            with self._changed:
                self._counts["malformed"] += 1
            if self._counts["malformed"] == 1:
                self._report(f"a message on {self._key} makes no sense: {error}")
            return
        said = None
        with self._changed:
            if frame is None:
                self._ended = True
            elif not self._ended:
                said = self._accept(frame, received)
            self._changed.notify_all()
        if said is not None:
            self._report(said)

    def end(self) -> None:
        """End the stream like its publisher: the received frames are still yielded, and no others."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def __iter__(self) -> Iterator[DepthFrame]:
        while (taken := self._take()) is not None:
            self.stream, frame, received = taken
            put_recent(self._received, frame.number, received, FRAMES_KEPT)
            yield frame

    def received_at(self, number: int) -> float:
        """When one of the last yielded frames was received, in seconds of the monotonic clock."""
        return self._received[number]

    def _accept(self, frame: DepthFrame, received: float) -> str | None:
        """Keep a frame that belongs to the stream or starts another; returns a message to report, if any."""
        self._counts["received"] += 1
        misfit = None if self._last is None else find_misfit(frame, self._last)
        if misfit is not None:
            self._rejected.append(frame)
            if not begins_a_stream(self._rejected):
                self._counts["rejected"] += 1
                cause, words = misfit
                first = cause not in self._reported
                self._reported.add(cause)
                return f"a frame on {self._key} {words}; such frames are left out" if first else None
            self._last_stream += 1
        if self._newest is not None:
            self._counts["skipped"] += 1
        self._newest = self._last_stream, frame, received
        self._period_s = math.inf if misfit or self._last is None else frame.time_s - self._last.time_s
        self._last = frame
        self._rejected.clear()
        if misfit is None:
            return None
        size = f"{frame.intrinsics.width}x{frame.intrinsics.height}"
        return f"another stream of frames, {size}, has begun on {self._key}; tracking starts again"

    def _take(self) -> tuple[int, DepthFrame, float] | None:
        """Wait for the newest frame, with its stream and reception; None at the end."""
        with self._changed:
            if not self._wait(min(self._notice, self._idle)) and self._notice < self._idle:
                self._report(f"no frame comes on {self._key}; waiting for one")
                self._wait(self._idle - self._notice)
            if not self._is_ready():
                self._report(f"no frame came on {self._key} for {self._idle:g} s; ending")
                self._ended = True
            taken, self._newest = self._newest, None
            return taken

    def _wait(self, seconds: float) -> bool:
        return self._changed.wait_for(self._is_ready, None if math.isinf(seconds) else seconds)

    def _is_ready(self) -> bool:
        return self._newest is not None or self._ended


def find_misfit(frame: DepthFrame, last: DepthFrame) -> tuple[str, str] | None:
    """Why a frame cannot follow another one: the cause and a message; None if it can."""
    camera, other = frame.intrinsics, last.intrinsics
    if (camera.width, camera.height) != (other.width, other.height):
        return "size", f"is {camera.width}x{camera.height}, those before {other.width}x{other.height}"
    if camera != other:
        return "intrinsics", "has other intrinsics than those before"
    if frame.depth_scale != last.depth_scale:
        return (
            "scale",
            f"has {frame.depth_scale:g} units of depth per metre, those before {last.depth_scale:g}",
        )
    if frame.number <= last.number or frame.time_s <= last.time_s:
        before = f"the one before number {last.number} of {last.time_s:g} s"
        return "order", f"is number {frame.number} of {frame.time_s:g} s, {before}"
    return None


def begins_a_stream(rejected: Sequence[DepthFrame]) -> bool:
    """Whether `NEW_STREAM_FRAMES` rejected frames, up to the last, have its camera and follow each other."""
    newest = rejected[-1]
    alike = [f for f in rejected if (f.intrinsics, f.depth_scale) == (newest.intrinsics, newest.depth_scale)]
    last = alike[-NEW_STREAM_FRAMES:]
    return len(last) == NEW_STREAM_FRAMES and all(find_misfit(b, a) is None for a, b in pairwise(last))


def from_first_seen(frames: Iterator[DepthFrame], report: Callable[[str], None]) -> Iterator[DepthFrame]:
    """Skip the frames before the first one with depth: tracking cannot start from them.

    `report` is called with a message for the user at the first skipped frame.
    """
    for passed, frame in enumerate(frames):
        if frame.depth.any():
            yield frame
            break
        if passed == 0:
            report("frames come, but nothing is measured in them; waiting for one that shows depth")
    yield from frames
