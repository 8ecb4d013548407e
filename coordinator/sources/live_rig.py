"""Which frames of several live cameras belong together. A state machine without clock and threads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from common.frame import DepthFrame
from coordinator.sources.live_stream import ORDER, LiveCamera, LiveStream
from coordinator.stopwatch import NOTICE_S

COUNTED = ("received", "skipped", "rejected", "malformed")
"""Received frames are tracked, skipped because a newer one came, or rejected if they do not fit the stream.
Malformed messages are not frames."""


class LiveRig:
    """The newest frames of live cameras, of one or more; each event gives its time, seconds of any clock.

    There is a frame for each frame of the first camera that lives, with the newest of each other camera if
    that is new and near in time. No camera is waited for while another lives.

    A restarted camera goes on while another lives; else `begun`, the number of streams that began, increases,
    and tracking must start again.
    """

    def __init__(self, cameras: Sequence[LiveCamera]) -> None:
        self.streams = tuple(map(LiveStream, cameras))
        self.counts = dict.fromkeys(COUNTED, 0)
        self.begun = 0
        self.lead = self.streams[0]  # the camera of the last taken frame
        self._last: DepthFrame | None = None  # the last taken frame since then
        self._first = math.inf  # when the first frame was received
        self._all_heard = False  # or those that were not are reported

    def lives(self, now: float) -> bool:
        """Whether any camera has sent a frame recently."""
        return any(each.lives(now) for each in self.streams)

    def accept(self, frame: DepthFrame, now: float, place: int = 0) -> str | None:
        """Receive a frame of the camera at a place: keep it if it belongs to its stream or starts another.

        Returns a message for the user, if there is any.
        """
        stream, said = self.streams[place], None
        key = stream.camera.key
        self.counts["received"] += 1
        clock = next((each for each in self.streams if each is not stream and each.lives(now)), None)
        misfit = stream.misfit(frame)
        if misfit is not None:
            cause, words = misfit
            if not stream.reject(frame):
                self.counts["rejected"] += 1
                first = cause not in stream.reported
                stream.reported.add(cause)
                return f"a frame on {key} {words}; such frames are left out" if first else None
            goes_on = clock is not None and cause == ORDER
            stream.begin(frame, goes_on=goes_on)
            size = f"{frame.intrinsics.width}x{frame.intrinsics.height}"
            then = "tracking goes on" if goes_on else "tracking starts again"
            said = f"another stream of frames, {size}, has begun on {key}; {then}"
            if not goes_on:
                self.begun, self._last = self.begun + 1, None
        if stream.waiting is not None:
            self.counts["skipped"] += 1
        if stream.accept(frame, now, clock):
            said = f"the times on {key} do not fit time_offset_s; its clock is measured by reception"
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
        return next((each for each, frame in waiting if frame.time_s > last_s), None)

    def take(self, now: float) -> DepthFrame | None:
        """The next frame, with those of the other cameras that are near in time; None if none waits.

        Its number is after that of the last frame, also if that was another camera's.
        """
        lead = self.next(now)
        if lead is None:
            return None
        frame, others = lead.take(), list[DepthFrame]()
        for each in self.streams:
            near = min(lead.period_s, each.period_s)
            if each.waiting is not None and abs(each.waiting.time_s - frame.time_s) <= near < math.inf:
                others.append(each.take())
        number = frame.number if self._last is None else max(frame.number, self._last.number + 1)
        self.lead, self._last = lead, replace(frame, number=number, others=tuple(others))
        return self._last
