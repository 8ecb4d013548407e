"""What the loop over frames stands on: frames that are read before their turn, and seconds by stage."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Self

from common.frame import DepthFrame


class Lookahead:
    """Iterates over frames; `peek` reads the one whose turn is next."""

    def __init__(self, frames: Iterable[DepthFrame]) -> None:
        self._frames = iter(frames)
        self._peeked = False
        self._next: DepthFrame | None = None  # None at the end
        self._error: Exception | None = None

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> DepthFrame:
        frame = self.peek()
        self._peeked = False
        if self._error is not None:
            raise self._error
        if frame is None:
            raise StopIteration
        return frame

    def peek(self) -> DepthFrame | None:
        """The frame that comes next; None at the end, or where it cannot be read: its turn raises that."""
        if not self._peeked:
            try:
                self._next = next(self._frames, None)
            except Exception as error:  # noqa: BLE001 - whatever it is, it must not harm the frame before
                self._next, self._error = None, error
            self._peeked = True
        return self._next


class Stopwatch:
    """Seconds by stage of one frame; runs only while the coordinator works on it, or waits for it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Charge the body to a stage."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began
