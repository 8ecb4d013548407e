"""Workers of our own: processes that are started, started again when they die, and ended with us."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from common.errors import BusError
from common.transport.endpoints import LOCAL
from common.transport.opening import open_router
from coordinator.pool.options import Pool

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
FRUITLESS_STARTS = 3  # in a row, none of them serving, until we give up
GRACE_S = 2.0  # for a process to end by itself
ABSENCE_S = 10.0  # for which a worker that has served may be away
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
    """The worker process of a pool, if it has one: it has `pool.lanes` lanes, and meets us at `endpoint`."""

    def __init__(self, pool: Pool, name: str, endpoint: str, folder: Path) -> None:
        self._command = [*pool.worker_command, "--lanes", str(pool.lanes), "--connect", endpoint, "--tied"]
        self._fruitless = 0
        self.restarted = 0
        names = [name] if pool.lanes else []
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
            elif now > worker.away_since + ABSENCE_S:
                worker.process.kill()

    def restart_dead(self) -> list[str]:
        """Start those that have died again; gives a line for each. BusError if that has become pointless."""
        dead = [worker for worker in self.workers.values() if worker.process.poll() is not None]
        return [self._restart(worker) for worker in dead]

    def stop(self) -> None:
        """End them all; those that do not end in time are killed."""
        processes = [worker.process for worker in self.workers.values()]
        for process in processes:
            process.send_signal(signal.SIGTERM)
        for process in processes:
            end(process)

    def _restart(self, worker: LocalWorker) -> str:
        how = describe_end(worker.process.returncode)
        self._fruitless += not worker.served
        if self._fruitless >= FRUITLESS_STARTS:
            lines = worker.log.read_text(errors="replace").split("\n")
            last = next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
            raise BusError(f"local workers do not start; the last {how}: {last}")
        end(worker.process)
        self.workers[worker.name] = self._start(worker.name, worker.log)
        self.restarted += 1
        return f"worker {worker.name} {how}; starting it again"

    def _start(self, name: str, log: Path) -> LocalWorker:
        with log.open("wb") as stderr:
            process = subprocess.Popen(
                [*self._command, "--name", name],
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
        process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def describe_end(code: int) -> str:
    """How a process ended, in words."""
    return f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"


def private_folder() -> tempfile.TemporaryDirectory[str]:
    """A folder of our own whose path is short enough for the socket at which we meet."""
    usual = len(tempfile.gettempdir()) <= LONGEST_FOLDER
    return tempfile.TemporaryDirectory(prefix="gepf-", dir=None if usual else "/tmp")


@dataclass(frozen=True, slots=True, eq=False)
class SharedPool:
    """One pool for several runs at once: a router within this process, and the local worker behind it."""

    endpoint: str
    workers: LocalWorkers
    requested: Pool

    def of_a_run(self) -> Pool:
        """The pool as one of the runs sees it: without workers of its own, through a socket of this host."""
        through = replace(self.requested, connect=self.endpoint, listen=None, security=None)
        return replace(through, workers=0, requested=self.requested)


@contextmanager
def shared_pool(pool: Pool) -> Iterator[SharedPool]:
    """Start the local worker of `pool`, and let others join as it says, for as long as the context lasts."""
    with private_folder() as name:
        folder = Path(name)
        local = f"{LOCAL}/{folder / 'bus'}"
        with open_router([local, *pool.listen_endpoints], pool.connect_endpoints, pool.security):
            workers = LocalWorkers(pool, "shared-0", local, folder)
            try:
                yield SharedPool(local, workers, pool)
            finally:
                workers.stop()
