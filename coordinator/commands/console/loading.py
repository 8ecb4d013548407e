"""A line for people who wait while libraries load."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer
from typing import TYPE_CHECKING

from coordinator.commands.console.interrupts import ended_at_once

if TYPE_CHECKING:
    from coordinator.commands.console.progress import Show

SOON = 0.3  # seconds


@contextmanager
def loading(show: Show, text: str) -> Iterator[None]:
    """Say what is to be done, if the libraries that the context imports take longer than a moment.

    An interrupt meanwhile ends the process at once: some libraries take it for a fault of their own.
    """
    timer = Timer(SOON, show.say, [text])
    timer.daemon = True
    timer.start()
    try:
        with ended_at_once():
            yield
    finally:
        timer.cancel()
