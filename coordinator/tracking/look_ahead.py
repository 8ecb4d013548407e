"""Frames one after the other, where the next one may be had before its turn."""

from __future__ import annotations

from collections.abc import Iterable
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
