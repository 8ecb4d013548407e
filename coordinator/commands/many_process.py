"""One run of several, in a process of its own: forked from one that has loaded all, it starts in a moment."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
from contextlib import suppress
from multiprocessing.connection import Connection, wait

from rich.console import Console

from common.errors import GepfError, InputError
from coordinator.commands.console import (
    DONE,
    ENDING,
    FAILED,
    INPUT_AT_FAULT,
    INTERRUPTED,
    NOT_TRACKED,
    end_as_interrupted,
    noted_interrupts,
)
from coordinator.commands.job import Job
from coordinator.commands.progress import Show
from coordinator.commands.track import track
from coordinator.commands.workers import connect_workers


class DistantShow(Show):
    """Lines that another process shows."""

    def __init__(self, pipe: Connection) -> None:
        super().__init__(Console(quiet=True))
        self._pipe = pipe

    def say(self, text: str) -> None:
        """Send a line, if the other process still listens."""
        with suppress(OSError):
            self._pipe.send(text)

    warn = say


def track_one(job: Job, pipe: Connection) -> None:
    """The body of the process: track, and exit with the code that a `gepf track` of its own would have."""
    os.setpgid(0, 0)  # Ctrl-C goes to who started us, and from there to us, once
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells have what they start behind ignore it
    end_as_interrupted()
    end_with_parent()
    show = DistantShow(pipe)
    log = logging.getLogger()
    log.handlers = [PipeHandler(show)]
    log.setLevel(logging.WARNING)
    sys.exit(code_of(job, show))


def code_of(job: Job, show: DistantShow) -> int:
    """Do the run; what ends it is the last line that it says."""
    try:
        with noted_interrupts(*ENDING):
            tracked = track(job, show, connect_workers)
    except KeyboardInterrupt as interrupt:
        if isinstance(interrupt.__cause__, GepfError):  # results that could not be kept, say
            show.say(str(interrupt.__cause__))
        return INTERRUPTED
    except GepfError as error:
        show.say(str(error))
        return INPUT_AT_FAULT if isinstance(error, InputError) else FAILED
    except Exception as error:  # noqa: BLE001 one run's fault is not another's
        show.say(f"{type(error).__name__}: {error}")
        return FAILED
    return DONE if tracked else NOT_TRACKED


def end_with_parent() -> None:
    """Have this process interrupted when the one that started it is gone, however that ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=interrupt_after, args=(parent.sentinel,), daemon=True).start()


def interrupt_after(sentinel: int) -> None:
    """Wait for the other process's end, then interrupt our own."""
    wait([sentinel])
    os.kill(os.getpid(), signal.SIGINT)


class PipeHandler(logging.Handler):
    """Sends warnings as lines."""

    def __init__(self, show: DistantShow) -> None:
        super().__init__(logging.WARNING)
        self._show = show

    def emit(self, record: logging.LogRecord) -> None:
        """Send one."""
        self._show.say(record.getMessage())
