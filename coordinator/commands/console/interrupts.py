"""Ctrl-C while libraries work that take any exception for a fault of their own."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

ENDING = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """Whether the user has asked to end, even where the KeyboardInterrupt that says so was swallowed."""

    def __init__(self) -> None:
        self.noted = False

    def note(self, *_: object) -> NoReturn:
        """Handle a signal."""
        self.noted = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if the user has asked to end."""
        if self.noted:
            raise KeyboardInterrupt


@contextmanager
def noted_interrupts() -> Iterator[Interrupts]:
    """Have SIGINT and SIGTERM remembered; a context that ends well although there was one raises it."""
    interrupts = Interrupts()
    before = {number: signal.signal(number, interrupts.note) for number in ENDING}
    try:
        yield interrupts
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    interrupts.check()
