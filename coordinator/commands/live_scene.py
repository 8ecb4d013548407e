"""What a camera and a tracker publish, as `gepf view zenoh:KEY` shows it: the newest, and nothing late."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from common.errors import ProtocolError
from common.frame import DepthFrame
from common.protocol.frames import decode_live, number_of
from common.recent import keep
from coordinator.results.live_results import Result, read_result

FRAMES_KEPT = 30  # depth images that wait for their results: one second
PAUSE_S = 0.2  # without results until depth is shown alone
NOTICE_S = 5.0  # without frames or results until this is reported


class LiveScene:
    """The newest published frames and results; threads of the bus call `receive_frame` and `receive_result`.

    A frame is decoded only if it is shown, and a result that was not shown is replaced by the next one.
    `report` is called with a message for the user when frames or results are missing, and at the first
    malformed message.
    """

    def __init__(
        self, key: str, results: str, report: Callable[[str], None], notice: float = NOTICE_S
    ) -> None:
        self._notice = notice
        self._key, self._results_key, self._report = key, results, report
        self._changed = threading.Condition()
        self._frames: dict[int, bytes] = {}  # by number, the newest last
        self._results: dict[str, Result] = {}  # the newest one on each key, until it is taken
        self._frame_at = self._result_at = time.monotonic()  # when the last one came
        self._tracked = False  # whether a result has ever come
        self._missing: str | None = None  # the last report of it
        self._malformed = False
        self.ended = False  # nothing more comes, unless the publisher or tracker is started again

    def receive_frame(self, key: str, payload: bytes) -> None:
        """Keep a depth image for its result."""
        try:
            number = number_of(payload)
        except ProtocolError:
            if self._decode(key, payload) is None and not self._tracked:
                self.ended = True
            return
        with self._changed:
            keep(self._frames, number, payload, FRAMES_KEPT)
            self._frame_at, self.ended = time.monotonic(), self.ended and self._tracked

    def receive_result(self, key: str, payload: bytes) -> None:
        """Keep a result in place of an older one."""
        try:
            result = read_result(payload)
        except ProtocolError as error:
            self.report_malformed(key, error)
            return
        with self._changed:
            self._result_at, self._tracked, self.ended = time.monotonic(), True, result is None
            if result is not None:
                self._results[key] = result
            self._changed.notify_all()

    def take_results(self) -> dict[str, Result]:
        """The newest results by key; empty if none comes for a while."""
        with self._changed:
            self._changed.wait_for(lambda: self._results, PAUSE_S)
            taken, self._results = self._results, {}
        self._report_missing()
        return taken

    @property
    def newest(self) -> int | None:
        """The number of the newest frame; None before the first."""
        with self._changed:
            return next(reversed(self._frames), None)

    def frame(self, number: int) -> DepthFrame | None:
        """The frame with a number; None if it did not come or is too old."""
        with self._changed:
            payload = self._frames.get(number)
        return None if payload is None else self._decode(self._key, payload)

    def report_malformed(self, key: str, error: Exception) -> None:
        """Report a malformed message, once."""
        if not self._malformed:
            self._malformed = True
            self._report(f"a message on {key} makes no sense: {error}")

    def _decode(self, key: str, payload: bytes) -> DepthFrame | None:
        try:
            return decode_live(payload)
        except ProtocolError as error:
            self.report_malformed(key, error)
            return None

    def _report_missing(self) -> None:
        now, missing = time.monotonic(), None
        if now - self._frame_at > self._notice:
            missing = f"no frame comes on {self._key}; is its publisher running, with this key and endpoint?"
        elif now - self._result_at > self._notice:
            missing = (
                f"frames come on {self._key}, but no results on {self._results_key}; gepf track "
                f"zenoh:{self._key} publishes them there, or where its --publish says: give that as --results"
            )
        if missing is not None and missing != self._missing:
            self._report(missing)
        self._missing = missing
