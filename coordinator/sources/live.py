"""Live input: depth frames that another process publishes; docs/live.md describes the messages."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gepf.common.errors import ProtocolError
from gepf.common.frame import Frame, View
from gepf.common.protocol.frames import decode_colour, decode_live
from gepf.common.recent import FRAMES_KEPT, put_recent
from gepf.coordinator.notices import NOTICE_S
from gepf.coordinator.sources.live_stream import LIMITS, ORDER, LiveCamera, LiveStream

COUNTED = ("received", "skipped", "rejected", "malformed")
"""Received frames are tracked, skipped because a newer one came, or rejected if they do not fit the stream.
Malformed messages are not frames."""


class LiveRig:
    """The newest frames of one or more live cameras: a state machine; its times are seconds of any clock.

    A camera is alive while its frames keep coming. Each frame of the first live camera gives a frame of the
    rig, with the newest image of each other camera if that is new and near in time. No camera is waited for
    while another is alive.

    A restarted camera continues if another is alive; otherwise `begun`, the number of streams that have
    begun, increases, and tracking must start again.
    """

    def __init__(self, cameras: Sequence[LiveCamera]) -> None:
        self.colours: dict[tuple[int, int], NDArray[np.uint8]] = {}  # by place and number, the last ones
        self.streams = tuple(map(LiveStream, cameras))
        self.counts = dict.fromkeys(COUNTED, 0)
        self.begun = 0
        self.lead = self.streams[0]  # the camera of the last taken frame
        self._last: Frame | None = None  # the last frame taken since the last stream began
        self._first = math.inf  # when the first frame was received
        self._all_heard = False  # whether all cameras have sent a frame, or the silent ones are reported

    def accept(self, view: View, now: float, place: int = 0) -> str | None:
        """Receive a frame of the camera at a place: keep it if it belongs to its stream or starts another.

        Returns a message for the user, if there is any.
        """
        stream, said = self.streams[place], None
        key = stream.camera.key
        self.counts["received"] += 1
        clock = next((each for each in self.streams if each is not stream and each.lives(now)), None)
        misfit = stream.misfit(view)
        if misfit is not None:
            cause, words = misfit
            if not stream.reject(view):
                self.counts["rejected"] += 1
                first = cause not in stream.reported
                stream.reported.add(cause)
                return f"a frame on {key} {words}; such frames are left out" if first else None
            goes_on = clock is not None and cause == ORDER
            stream.begin(view, goes_on=goes_on)
            size = f"{view.intrinsics.width}x{view.intrinsics.height}"
            then = "tracking continues" if goes_on else "tracking starts again"
            said = f"a new stream of {size} frames has begun on {key}; {then}"
            if not goes_on:
                self.begun, self._last = self.begun + 1, None
        if stream.waiting is not None:
            self.counts["skipped"] += 1
        if stream.accept(view, now, clock):
            said = f"the times on {key} contradict time_offset_s; the offset is estimated from arrival times"
        return said or self._miss(now)

    def _miss(self, now: float) -> str | None:
        """A message on the cameras that have sent nothing, once, some seconds after the first frame."""
        self._first = min(self._first, now)
        if self._all_heard or now - self._first < NOTICE_S:
            return None
        self._all_heard = True
        missing = [each.camera for each in self.streams if each.received == -math.inf]
        listed = " and ".join(f"from camera {each.camera} on {each.key}" for each in missing)
        return f"no frame has come {listed}; is its publisher running, with this key?" if missing else None

    def next(self, now: float) -> LiveStream | None:
        """The camera whose frame is next: the first that lives, else any; None if none waits."""
        living = [each for each in self.streams if each.lives(now)][:1]
        waiting = ((each, each.waiting) for each in living or self.streams if each.waiting is not None)
        last_s = -math.inf if self._last is None else self._last.time_s
        return next((each for each, view in waiting if view.time_s > last_s), None)

    def take(self, now: float) -> Frame | None:
        """The next frame, with those of the other cameras that are near in time; None if none waits.

        Its number is after that of the last frame, also if that was another camera's.
        """
        lead = self.next(now)
        if lead is None:
            return None
        views = [self._coloured(lead)]
        number, time_s = views[0].number, views[0].time_s
        for each in self.streams:
            near = min(lead.period_s, each.period_s)
            if each.waiting is not None and abs(each.waiting.time_s - time_s) <= near < math.inf:
                views.append(self._coloured(each))
        if self._last is not None:
            number = max(number, self._last.number + 1)
        self.lead, self._last = lead, Frame(number, time_s, tuple(views))
        return self._last

    def _coloured(self, stream: LiveStream) -> View:
        """The waiting image of a camera with its colours, if they have come."""
        view = stream.take()
        colours = self.colours.pop((self.streams.index(stream), view.number), None)
        return view if colours is None else replace(view, colours=colours)


class LiveFrames:
    """The newest frame at each request, of one camera or of a rig; iterates until the streams end.

    `LiveRig` says which frames belong together. A frame that does not fit its camera's stream is rejected and
    counted. If a few rejected frames fit each other, they start a new stream: the publisher was restarted, or
    there is another camera. Unless another camera is alive, tracking must then start again: `stream`, the
    number of the stream, changes immediately before the first frame of the new stream is yielded.

    Messages are received on a thread of the bus. `report` is called with a message for the user when no frame
    comes, when a new stream starts, at the first rejected frame of each cause, and if times do not fit. The
    iteration also ends after `idle` silent seconds; None to wait for ever.
    """

    def __init__(
        self,
        cameras: Sequence[LiveCamera],
        report: Callable[[str], None],
        notice: float = NOTICE_S,
        idle: float | None = None,
    ) -> None:
        self.cameras = tuple(cameras)
        self.stream = 0  # of the last yielded frame
        self.explain: Callable[[], str] = str  # why no frame comes, if the source knows
        self._rig = LiveRig(cameras)
        self._idle = math.inf if idle is None else idle
        self._notice = notice
        self._report = report
        self._changed = threading.Condition()
        self._received: dict[int, float] = {}  # when frames were received, by number, the last yielded ones
        self._ended = False

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages of each kind in `COUNTED` so far."""
        with self._changed:
            return self._rig.counts.copy()

    @property
    def is_ready(self) -> bool:
        """Whether the next frame waits, or the stream has ended."""
        with self._changed:
            return self._ended or self._rig.next(time.monotonic()) is not None

    @property
    def period_s(self) -> float:
        """Time in seconds between the last two frames of the stream; infinite if there are not two."""
        with self._changed:
            return self._rig.lead.last_period_s

    def wait(self, seconds: float) -> None:
        """Wait for the next frame or the end of the stream, for at most `seconds`."""
        with self._changed:
            self._changed.wait_for(lambda: self.is_ready, None if math.isinf(seconds) else seconds)

    def receive(
        self, payload: bytes, *, place: int = 0, decode: Callable[[bytes], View | None] = decode_live
    ) -> None:
        """Receive a message of a camera, by its place; an older frame that is still waiting is skipped.

        `decode` returns its image, or None at the end of the stream; ProtocolError if it is malformed.
        """
        received, rig = time.monotonic(), self._rig
        try:
            view = decode(payload)
        except ProtocolError as error:
            with self._changed:
                rig.counts["malformed"] += 1
                is_first = rig.counts["malformed"] == 1
            if is_first:
                self._report(f"a message on {self.cameras[place].key} is malformed: {error}")
            return
        said = None
        with self._changed:
            if view is None:
                rig.streams[place].ended = True
                self._ended |= not any(each.lives(received) for each in rig.streams)
            elif not self._ended:
                said = rig.accept(view, received, place)
            self._changed.notify_all()
        if said is not None:
            self._report(said)

    def receive_colour(self, payload: bytes, *, place: int = 0) -> None:
        """Receive the colour image of a frame; no frame waits for it. Damaged ones are ignored."""
        with suppress(ProtocolError, OSError):
            number, jpeg = decode_colour(payload)
            with Image.open(BytesIO(jpeg), formats=("JPEG",)) as image:
                colours = np.array(image.convert("RGB"))
            with self._changed:
                put_recent(self._rig.colours, (place, number), colours, LIMITS.colours_kept)

    def say(self, message: str) -> None:
        """Report a message of the source for the user."""
        self._report(message)

    def end(self) -> None:
        """End the stream like its publisher: the received frames are still yielded, and no others."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def __iter__(self) -> Iterator[Frame]:
        while (taken := self._take()) is not None:
            self.stream, frame, received = taken
            put_recent(self._received, frame.number, received, FRAMES_KEPT)
            yield frame

    def received_at(self, number: int) -> float:
        """When one of the last yielded frames was received, in seconds of the monotonic clock."""
        return self._received[number]

    def _take(self) -> tuple[int, Frame, float] | None:
        """Wait for the newest frame, with its stream and reception; None at the end."""
        keys = " and ".join(camera.key for camera in self.cameras)
        with self._changed:
            self.wait(min(self._notice, self._idle))
            if not self.is_ready and self._notice < self._idle:
                self._report(f"no frame comes on {keys}{self.explain()}; waiting for one")
                self.wait(self._idle - self._notice)
            if not self.is_ready:
                self._report(f"no frame came on {keys} for {self._idle:g} s{self.explain()}; ending")
                self._ended = True
            frame = self._rig.take(time.monotonic())
            return None if frame is None else (self._rig.begun, frame, self._rig.lead.received)


def from_first_seen(frames: Iterator[Frame], report: Callable[[str], None]) -> Iterator[Frame]:
    """Skip the frames before the first one with depth: tracking cannot start from them.

    `report` is called with a message for the user at the first skipped frame.
    """
    for passed, frame in enumerate(frames):
        if any(view.depth.any() for view in frame.views):
            yield frame
            break
        if passed == 0:
            report("frames come, but without depth; waiting for one with depth")
    yield from frames
