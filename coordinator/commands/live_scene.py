"""What a camera and a tracker publish, as `gepf view zenoh:KEY` shows it: the newest, and nothing late."""

from __future__ import annotations

import time
from collections.abc import Callable

from common.errors import ProtocolError
from common.frame import DepthFrame
from common.protocol.frames import decode_live, number_of
from common.recent import put_recent
from coordinator.results.live_results import Result, read_result
from coordinator.sources.camera import DEFAULT_FPS
from coordinator.sources.frame_recorder import WAITING_FRAMES
from coordinator.stopwatch import NOTICE_S

Take = Callable[[], list[tuple[str, bytes]]]
"""Returns new messages with their keys."""


class LiveScene:
    """The newest published frames and results.

    A frame is decoded only if it is shown, and a result that was not shown is replaced by the next one.
    `report` is called with a message for the user when frames or results are missing, and at the first
    malformed message.
    """

    def __init__(
        self, frames: Take, results: Take, report: Callable[[str], None], notice: float = NOTICE_S
    ) -> None:
        self._take_frames, self._take_results, self._report, self._notice = frames, results, report, notice
        self._frames: dict[int, bytes] = {}  # by number, the newest last
        self._frame_at = self._result_at = time.monotonic()  # when the last one came
        self._tracked = False  # whether a result has ever come
        self._said = set[str]()
        self.ended = False  # nothing more comes, unless the publisher or tracker is started again

    def take_results(self) -> dict[str, Result]:
        """The newest results by key; empty if none comes for a while."""
        taken = dict[str, Result]()
        for _ in range(3):  # 0.2 s without results, then depth is shown alone
            if taken:
                break
            time.sleep(2.0 / DEFAULT_FPS)  # for half of a usual camera's frames
            messages = self._take_results()
            for key, payload in self._take_frames():
                self._receive_frame(key, payload)
            for key, payload in messages:
                self._receive_result(key, payload, taken)
        now = time.monotonic()
        if now - self._frame_at > self._notice:
            self._say_once("no frame comes; is its publisher running, with this key and endpoint?")
        elif now - self._result_at > self._notice:
            self._say_once("frames come, but no results; is gepf track running? Give --results its --publish")
        return taken

    @property
    def newest(self) -> int | None:
        """The number of the newest frame; None before the first."""
        return next(reversed(self._frames), None)

    def frame(self, number: int) -> DepthFrame | None:
        """The frame with a number; None if it did not come or is too old."""
        payload = self._frames.get(number)
        return None if payload is None else self._decode("the key of frames", payload)

    def _receive_frame(self, key: str, payload: bytes) -> None:
        try:
            put_recent(self._frames, number_of(payload), payload, WAITING_FRAMES)
        except ProtocolError:
            self.ended = self.ended or (self._decode(key, payload) is None and not self._tracked)
            return
        self._frame_at, self.ended = time.monotonic(), self.ended and self._tracked

    def _receive_result(self, key: str, payload: bytes, taken: dict[str, Result]) -> None:
        """Keep a result in place of an older one."""
        try:
            result = read_result(payload)
        except ProtocolError as error:
            self.report_malformed(key, error)
            return
        self._result_at, self._tracked, self.ended = time.monotonic(), True, result is None
        if result is not None:
            taken[key] = result

    def report_malformed(self, key: str, error: Exception) -> None:
        """Report a malformed message, once for each key."""
        self._say_once(f"a message on {key} makes no sense", f": {error}")

    def _say_once(self, line: str, detail: str = "") -> None:
        if line not in self._said:
            self._said.add(line)
            self._report(line + detail)

    def _decode(self, key: str, payload: bytes) -> DepthFrame | None:
        try:
            return decode_live(payload)
        except ProtocolError as error:
            self.report_malformed(key, error)
            return None
