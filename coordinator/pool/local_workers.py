"""Workers of our own: processes that are started, started again when they die, and ended with us."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import BusError

COMMAND = (sys.executable, "-m", "worker.cli")
THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
FRUITLESS_STARTS = 3  # in a row, none of them serving, until we give up
GRACE = 2.0  # seconds to end by themselves
ABSENCE = 10.0  # seconds for which one that has served may be away
LONGEST_FOLDER = 80  # characters; the path of a socket has at most 107


@dataclass(slots=True, eq=False)
class LocalWorker:
    """One of our processes; it ends when its standard input does, and so when we die."""

    name: str
    log: Path  # its standard error, which would garble ours
    process: subprocess.Popen[bytes]
    served: bool = False  # since it was started
    away_since: float | None = None  # after that


class LocalWorkers:
    """A fixed number of worker processes."""

    def __init__(self, names: Sequence[str], endpoint: str, folder: Path, command: Sequence[str]) -> None:
        self._endpoint = endpoint
        self._command = tuple(command)
        self._fruitless = 0
        self.restarted = 0
        self.workers = {name: self._start(name, folder / f"{name}.log") for name in names}

    def mark_serving(self, name: str) -> None:
        """A worker of this name has announced itself."""
        if name in self.workers:
            self.workers[name].served = True
            self._fruitless = 0

    def end_absent(self, present: Collection[str], now: float) -> None:
        """Kill those that have served and are away for long, as one that is frozen; they are dead then."""
        for worker in self.workers.values():
            if worker.name in present or not worker.served:
                worker.away_since = None
            elif worker.away_since is None:
                worker.away_since = now
            elif now > worker.away_since + ABSENCE:
                worker.process.kill()

    def restart_dead(self) -> list[str]:
        """Start those that have died again; gives a line for each. BusError if that has become pointless."""
        dead = [worker for worker in self.workers.values() if worker.process.poll() is not None]
        return [self._restart(worker) for worker in dead]

    def stop(self) -> None:
        """End them all; those that do not listen are killed."""
        processes = [worker.process for worker in self.workers.values()]
        for process in processes:
            process.send_signal(signal.SIGTERM)
        for process in processes:
            end(process)

    def _restart(self, worker: LocalWorker) -> str:
        how = describe_end(worker.process.returncode)
        self._fruitless += not worker.served
        if self._fruitless >= FRUITLESS_STARTS:
            raise BusError(f"local workers do not start; the last {how}: {last_line(worker.log)}")
        end(worker.process)
        self.workers[worker.name] = self._start(worker.name, worker.log)
        self.restarted += 1
        return f"worker {worker.name} {how}; starting it again"

    def _start(self, name: str, log: Path) -> LocalWorker:
        with log.open("wb") as stderr:
            process = subprocess.Popen(
                [*self._command, "--connect", self._endpoint, "--name", name, "--tied"],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                env={**os.environ, **dict.fromkeys(THREADS, "1")},
                start_new_session=True,  # an interrupt from the keyboard is for us; we end them
            )
        return LocalWorker(name, log, process)


def end(process: subprocess.Popen[bytes]) -> None:
    """Wait for a process to end; kill it if it does not."""
    if process.stdin is not None:
        process.stdin.close()
    try:
        process.wait(GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def describe_end(code: int) -> str:
    """How a process ended, in words."""
    return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


def last_line(log: Path) -> str:
    """The last thing that a process said."""
    lines = log.read_text(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")


def private_folder() -> tempfile.TemporaryDirectory[str]:
    """A folder of our own whose path is short enough for the socket at which we meet."""
    usual = len(tempfile.gettempdir()) <= LONGEST_FOLDER
    return tempfile.TemporaryDirectory(prefix="gepf-", dir=None if usual else "/tmp")
