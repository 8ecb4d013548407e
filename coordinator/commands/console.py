"""A process at a terminal: its exit codes, interrupts that libraries swallow, and a line while they load."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, NoReturn

if TYPE_CHECKING:
    from coordinator.commands.progress import Show

DONE, FAILED, INPUT_AT_FAULT, INTERRUPTED = 0, 1, 2, 128 + signal.SIGINT
NOT_TRACKED = 3  # done, but most frames were not
SILENCE_S = 0.3  # while libraries load, until a line says what is to be done
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

    def forget(self) -> None:
        """What was asked for is being done."""
        self.noted = False


INTERRUPTS = Interrupts()
"""Those of this process, as signals are."""


@contextmanager
def noted_interrupts(*signals: signal.Signals) -> Iterator[Interrupts]:
    """Have signals remembered; where there was one, the context ends with KeyboardInterrupt, however it ends.

    Signals that are ignored stay so.
    """
    before = {number: signal.getsignal(number) for number in signals if is_heard(number)}
    for number in before:
        signal.signal(number, INTERRUPTS.note)
    try:
        yield INTERRUPTS
    except Exception as error:
        if INTERRUPTS.noted:
            raise KeyboardInterrupt from error
        raise
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    INTERRUPTS.check()


@contextmanager
def ended_at_once() -> Iterator[None]:
    """Let an interrupt end the process as the system does, while there is nothing to be kept."""
    if not is_heard(signal.SIGINT):
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def is_heard(number: signal.Signals) -> bool:
    """Whether a signal is not ignored, and this thread may say what it does."""
    here = threading.current_thread() is threading.main_thread()
    return here and signal.getsignal(number) is not signal.SIG_IGN


def end_as_interrupted() -> None:
    """Let SIGTERM end a run as Ctrl-C does, so that its frames are kept."""
    signal.signal(signal.SIGTERM, INTERRUPTS.note)


@contextmanager
def loading(show: Show, text: str) -> Iterator[None]:
    """Say what is to be done, if the libraries that the context imports take longer than a moment.

    An interrupt meanwhile ends the process at once: some libraries take it for a fault of their own.
    """
    timer = threading.Timer(SILENCE_S, show.say, [text])
    timer.daemon = True
    timer.start()
    try:
        with ended_at_once():
            yield
    finally:
        timer.cancel()
