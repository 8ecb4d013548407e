"""Tells a process that is frozen from one that waits for a processor, from what Linux says of its threads."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

WAITING = ("R", "D")  # states of threads that would run if there were a processor, or a page of memory
TICKS = os.sysconf("SC_CLK_TCK")  # per second


class WatchedProcess:
    """How long a process was able to run while it was watched.

    It was able to run while it used a processor, and also while none of its threads wanted one, because they
    waited for something else, as in a deadlock, or were stopped. The rest of the time it waited for a
    processor, which says nothing about the process.

    Of the time between two looks, at most `max_look_s` counts: if it was longer, the observer itself was not
    running.
    """

    def __init__(self, pid: int, max_look_s: float = 1.0) -> None:
        self._max_look_s = max_look_s
        self._threads = Path(f"/proc/{pid}/task")
        self._last: tuple[float, float] | None = None  # time of the last look, processor time then

    def able_since(self, now: float) -> float:
        """Seconds since the last look in which it was able to run; 0 at the first, and if it has ended.

        Args:
            now: Seconds from any origin.
        """
        found = list(self._read())
        used = sum(seconds for _, seconds in found)
        last, self._last = self._last, (now, used)
        if last is None or not found:
            return 0.0
        watched = min(now - last[0], self._max_look_s)
        if not any(state in WAITING for state, _ in found):
            return watched
        return max(0.0, min(used - last[1], watched))

    def pause(self) -> None:
        """Stop watching it until the next look, which then counts as the first."""
        self._last = None

    def _read(self) -> Iterator[tuple[str, float]]:
        """State and processor time of each thread; see proc_pid_stat(5)."""
        try:
            threads = list(self._threads.iterdir())
        except OSError:  # it has ended
            return
        for thread in threads:
            try:
                fields = (thread / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:  # it has just ended
                continue
            yield fields[0], (int(fields[11]) + int(fields[12])) / TICKS
