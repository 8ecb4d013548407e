"""Depth frames that some other process publishes while they are tracked: docs/live.md has their form."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from common.errors import ProtocolError
from common.frame import DepthFrame
from common.protocol.frames import decode_live
from common.protocol.keys import check_stream

SCHEME = "zenoh:"
NOTICE = 5.0  # seconds without a frame until we say so


def live_key(sequence: Path) -> str | None:
    """The key of `zenoh:KEY`; None for what is recorded. InputError if the key is none."""
    text = str(sequence)
    return check_stream(text.removeprefix(SCHEME)) if text.startswith(SCHEME) else None


@dataclass(frozen=True, slots=True)
class LiveCounts:
    """What has become of the messages that came."""

    received: int = 0  # depth frames
    skipped: int = 0  # of them: a newer one came before they could be tracked
    malformed: int = 0  # not among them: messages that make no sense


class LiveFrames:
    """The newest frame whenever one is asked for; iterates until the stream ends.

    Messages are received on a thread of the bus. `report` is called with a line for people when the stream
    is silent, and at the first message that makes no sense. The stream also ends when it was silent for
    `idle` seconds; None to wait for ever.
    """

    def __init__(
        self, key: str, report: Callable[[str], None], notice: float = NOTICE, idle: float | None = None
    ) -> None:
        self._key = key
        self._idle = math.inf if idle is None else idle
        self._notice = notice
        self._report = report
        self._changed = threading.Condition()
        self._newest: DepthFrame | None = None
        self._ended = False
        self._counts = LiveCounts()

    @property
    def counts(self) -> LiveCounts:
        """What came so far."""
        with self._changed:
            return self._counts

    def receive(self, payload: bytes) -> None:
        """Take a message; an older frame that still waits is skipped."""
        try:
            frame = decode_live(payload)
        except ProtocolError as error:
            self._count_malformed(error)
            return
        with self._changed:
            if frame is None:
                self._ended = True
            elif not self._ended:
                self._keep(frame)
            self._changed.notify_all()

    def end(self) -> None:
        """End the stream as its publisher does: who waits for a frame gets those that came, and no more."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def __iter__(self) -> Iterator[DepthFrame]:
        while (frame := self._take()) is not None:
            yield frame

    def _keep(self, frame: DepthFrame) -> None:
        counts = self._counts
        skipped = counts.skipped + (self._newest is not None)
        self._counts = replace(counts, received=counts.received + 1, skipped=skipped)
        self._newest = frame

    def _take(self) -> DepthFrame | None:
        """The newest frame as soon as there is one; None at the end."""
        with self._changed:
            if not self._wait(min(self._notice, self._idle)) and self._notice < self._idle:
                self._report(f"no frame comes on {self._key}; waiting for one")
                self._wait(self._idle - self._notice)
            if not self._is_ready():
                self._report(f"no frame came on {self._key} for {self._idle:g} s; ending")
                self._ended = True
            frame, self._newest = self._newest, None
            return frame

    def _wait(self, seconds: float) -> bool:
        return self._changed.wait_for(self._is_ready, None if math.isinf(seconds) else seconds)

    def _is_ready(self) -> bool:
        return self._newest is not None or self._ended

    def _count_malformed(self, error: ProtocolError) -> None:
        with self._changed:
            malformed = self._counts.malformed + 1
            self._counts = replace(self._counts, malformed=malformed)
        if malformed == 1:
            self._report(f"a message on {self._key} makes no sense: {error}")


def from_first_seen(frames: Iterator[DepthFrame], report: Callable[[str], None]) -> Iterator[DepthFrame]:
    """Pass over the frames before the first one with any depth: nothing can start from them.

    `report` is called with a line for people at the first that is passed over.
    """
    for passed, frame in enumerate(frames):
        if frame.depth.any():
            yield frame
            break
        if passed == 0:
            report("frames come, but nothing is measured in them; waiting for one that shows depth")
    yield from frames
