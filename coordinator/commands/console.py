"""Exit codes of a process, and interrupts that libraries suppress."""

from __future__ import annotations

import enum
import errno
import gc
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from gepf.common.errors import GepfError, InputError

DEBUG = "GEPF_DEBUG"


class ExitCode(enum.IntEnum):
    """How a process ended."""

    DONE = 0
    FAILED = 1
    WRONG_INPUT = 2
    NOT_TRACKED = 3  # done, but most frames were not tracked
    INTERRUPTED = 128 + signal.SIGINT


class Interrupts:
    """Whether the user interrupted, even if a library suppressed the KeyboardInterrupt."""

    noted = False

    def note(self, *_: object) -> NoReturn:
        """Handle a signal."""
        self.noted = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raise KeyboardInterrupt if the user interrupted."""
        if self.noted:
            raise KeyboardInterrupt


INTERRUPTS = Interrupts()
"""The interrupts of this process."""


@contextmanager
def noted_interrupts() -> Iterator[None]:
    """Note Ctrl-C and SIGTERM; after one of them the context always ends with KeyboardInterrupt.

    Ignored signals stay ignored.
    """
    heard = [number for number in (signal.SIGINT, signal.SIGTERM) if is_heard(number)]
    before = {number: signal.signal(number, INTERRUPTS.note) for number in heard}
    try:
        yield
        INTERRUPTS.check()
    except Exception as error:
        if INTERRUPTS.noted:
            raise KeyboardInterrupt from error
        raise
    finally:
        INTERRUPTS.noted = False
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def loading() -> Iterator[None]:
    """Import libraries: an interrupt ends the process at once, because some libraries suppress it.

    Garbage is not collected meanwhile; this would take a tenth of the time.
    """
    heard = is_heard(signal.SIGINT)
    before = signal.signal(signal.SIGINT, signal.SIG_DFL) if heard else None
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        if heard:
            signal.signal(signal.SIGINT, before)


def is_heard(number: signal.Signals) -> bool:
    """Whether a signal is not ignored, and this thread may set its handler."""
    here = threading.current_thread() is threading.main_thread()
    return here and signal.getsignal(number) is not signal.SIG_IGN


def exit_code(work: Callable[[], int], name: str) -> int:
    """Do some work and return its exit code: 2 for wrong input, 1 for any other error.

    An error is reported as one line on stderr, after `name`.
    """
    try:
        with noted_interrupts():
            return work()
    except KeyboardInterrupt as interrupt:
        if isinstance(interrupt.__cause__, GepfError):  # for instance, results could not be written
            complain(name, interrupt.__cause__)
        say(name, "stopped")
        return ExitCode.INTERRUPTED
    except Exception as error:  # noqa: BLE001 users get one line for any error
        complain(name, error)
        return ExitCode.WRONG_INPUT if isinstance(error, InputError) else ExitCode.FAILED


def complain(name: str, error: Exception) -> None:
    """Report an error in one line, after its traceback if debugging."""
    if os.environ.get(DEBUG, "0") != "0":
        traceback.print_exception(error)
    say(name, str(error) if isinstance(error, GepfError) else describe_fault(error))


def describe_fault(error: Exception) -> str:
    """Message for an unexpected error, with a remedy if one is known."""
    if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
        where = f" for {error.filename}" if error.filename else ""
        then = "then continue a recording with gepf track --resume, or finish a live run with gepf report"
        return f"no space is left on the disk{where}; make room, {then}"
    return f"{type(error).__name__}: {error} (gepf --debug shows the traceback)"


def say(name: str, message: str) -> None:
    """Write one line to stderr."""
    sys.stderr.write(f"{name}: {' '.join(message.split())}\n")
