"""What a worker does, as one line that renews itself on a terminal."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self, TextIO

RENEWED_S = 1.0
RECENT_S = 5.0  # a run that has asked within this time is being served


class Activity:
    """Counts what a worker has done. Its methods may be called from any thread."""

    def __init__(self, lanes: int, clock: Callable[[], float] = time.monotonic) -> None:
        self.lanes = lanes
        self._clock = clock
        self._lock = threading.Lock()
        self._particles = 0
        self._asked: dict[str, float] = {}  # when each run asked last
        self._looked_at = clock()

    def refined(self, run: str, particles: int) -> None:
        """So many particles of a run were refined."""
        with self._lock:
            self._particles += particles
            self._asked[run] = self._clock()

    def line(self) -> str:
        """Lanes, runs that are served, and particles a second since the last call."""
        with self._lock:
            now = self._clock()
            rate = self._particles / max(now - self._looked_at, 1e-9)
            self._asked = {run: at for run, at in self._asked.items() if now - at < RECENT_S}
            runs, self._particles, self._looked_at = len(self._asked), 0, now
        doing = f"{counted(runs, 'run')} served, {rate:.0f} particles/s" if runs else "waiting for work"
        return f"{counted(self.lanes, 'lane')}, {doing}"


def counted(number: int, what: str) -> str:
    """A number and what it counts."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


class StatusLine:
    """Shows a line on a terminal and renews it every second; shows nothing elsewhere. A context manager."""

    def __init__(self, text: Callable[[], str], stream: TextIO | None = None, *, quiet: bool = False) -> None:
        self._text = text
        self._stream = sys.stderr if stream is None else stream
        self._shown = self._stream.isatty() and not quiet
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        if self._shown:
            threading.Thread(target=self._renew, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()

    def _renew(self) -> None:
        while not self._ended.wait(RENEWED_S):
            self._stream.write(f"\r\x1b[K{self._text()}")
            self._stream.flush()
