"""One run of several, in a process of its own: forked from one that has loaded all, it starts in a moment."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait

from common.errors import GepfError, InputError
from coordinator.commands.console.interrupts import ENDING, noted_interrupts
from coordinator.commands.console.progress import Advance, FrameMeter
from coordinator.commands.exit_codes import DONE, FAILED, INPUT_AT_FAULT, INTERRUPTED, NOT_TRACKED
from coordinator.commands.options.job import Job
from coordinator.commands.people.choice import track_recording
from coordinator.commands.workers import connect_workers, end_as_interrupted


@dataclass(frozen=True, slots=True)
class Report:
    """What a run has to say: a line, or how many of its frames are done."""

    line: str = ""
    done: int = 0
    total: int = 0


class DistantShow:
    """Progress that another process shows."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def say(self, text: str) -> None:
        """Send a line."""
        self.send(Report(line=text))

    def warn(self, text: str) -> None:
        """Send a line, as any other."""
        self.send(Report(line=text))

    @contextmanager
    def steps(self, text: str) -> Iterator[Advance]:
        """Keep steps of other things than frames for ourselves."""
        del text
        yield lambda *_: None

    def frames(self, total: int | None, done: int = 0) -> FrameMeter:
        """A meter that sends how far it is."""
        return DistantMeter(total, done, self)

    def send(self, report: Report) -> None:
        """Send, if somebody still listens."""
        try:
            self._pipe.send(report)
        except OSError:
            return


class DistantMeter(FrameMeter):
    """Counts frames for another process."""

    def __init__(self, total: int | None, done: int, show: DistantShow) -> None:
        super().__init__(total, done)
        self._show = show

    def show(self, text: str) -> None:
        """Send the count."""
        del text
        self._show.send(Report(done=self.done, total=self.total or 0))


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
            tracked = track_recording(job, show, connect_workers)
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
