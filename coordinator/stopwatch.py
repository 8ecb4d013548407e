"""Measures how long each stage of a frame takes; and after how long a wait is reported to the user."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

NOTICE_S = 5.0  # wait for a worker or frame before it is reported; also between progress lines in a log


class Stopwatch:
    """Seconds by stage of one frame: the time that the coordinator works on it or waits for it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of a `with` block to a stage."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - began
