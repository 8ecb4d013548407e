"""The local worker: a child process that is restarted when it dies and ends with this process."""

from __future__ import annotations

import os
import signal
import subprocess
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

from gepf.common.errors import BusError
from gepf.common.offer import CPU
from gepf.common.protocol import keys
from gepf.common.transport.bus import Bus
from gepf.common.transport.channels import ANSWER_S
from gepf.common.transport.endpoints import LOCAL
from gepf.common.transport.opening import open_router, private_folder
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.watched_process import WatchedProcess

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class LocalWorkerLimits(msgspec.Struct, frozen=True):
    """When a local worker is given up."""

    failed_starts: int = 3  #: successive starts without service, before the run ends
    absence_s: float = 10.0  #: longest absence of a worker that has served, while it was able to run
    silence_s: float = 20.0  #: longest silence of one that owes an answer: it fails before the request does


LIMITS = LocalWorkerLimits()


class LocalWorker:
    """The worker process of a pool with local lanes; it connects to this process at `endpoint`.

    Its presence is watched on `bus`. It ends when its standard input is closed, and so when this process
    dies.
    """

    def __init__(self, pool: Pool, name: str, bus: Bus, endpoint: str, folder: Path) -> None:
        self.name = name
        self.restarted = 0
        self._command = [*pool.worker_command, "--lanes", str(pool.lanes), "--connect", endpoint, "--tied"]
        self._command += [] if pool.kind == CPU else ["--kind", pool.kind]
        self._log = folder / f"{name}.log"  # its standard error, kept apart from ours
        self._failed_starts = 0
        self._present = False  # on the bus
        self._served = False  # since it was started
        self._silent_s = 0.0  # able to run, but absent after it has served, or without an answer
        self._was_silent = False  # at the last look it was absent, or owed an answer
        self.process = self._start() if pool.lanes else None
        if self.process is not None:
            bus.watch(keys.of_worker(name, "offer/**"), self._notice)

    def look_after(self, now: float, *, owes: bool = False) -> str | None:
        """Restart the worker if it has died; returns a message then. BusError after too many failed starts.

        A worker that has served, and then is absent or owes an answer for too long, counts as frozen and is
        killed. Only time in which it was able to run counts, so a busy machine gets no worker killed.

        Args:
            now: Seconds from any origin.
            owes: Whether it was asked, and has not answered since `heard`.
        """
        if self.process is None:
            return None
        if self._served:
            self._failed_starts = 0
        if not (self._served and (owes or not self._present)):
            self._end_silence()
        elif self._was_silent:
            self._silent_s += self._watched.able_since(now)
        else:  # most answers come before the next look, and watching a process takes time
            self._was_silent = True
        if self._silent_s > (LIMITS.silence_s if self._present else LIMITS.absence_s):
            self.process.kill()
        return None if self.process.poll() is None else self._restart(self.process)

    def heard(self) -> None:
        """It has answered."""
        if self.process is not None:
            self._end_silence()

    def _end_silence(self) -> None:
        """It is no longer silent."""
        self._silent_s, self._was_silent = 0.0, False
        self._watched.pause()

    def stop(self) -> None:
        """End the process; kill it if it does not end in time."""
        if self.process is not None:
            self.process.send_signal(signal.SIGTERM)
            end(self.process)

    def _notice(self, _: str, alive: bool) -> None:
        """It has joined or left; called on a thread of the bus."""
        self._present = alive
        self._served |= alive

    def _restart(self, ended: subprocess.Popen[bytes]) -> str:
        code = ended.returncode
        how = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        self._failed_starts += not self._served
        if self._failed_starts >= LIMITS.failed_starts:
            lines = self._log.read_text(errors="replace").split("\n")
            last = next((line.strip() for line in reversed(lines) if line.strip()), "it wrote no message")
            raise BusError(f"local workers do not start; the last {how}: {last}")
        end(ended)
        self._present = self._served = False
        self._end_silence()
        self.process = self._start()
        self.restarted += 1
        return f"worker {self.name} {how}; starting it again"

    def _start(self) -> subprocess.Popen[bytes]:
        with self._log.open("wb") as stderr:
            process = subprocess.Popen(
                [*self._command, "--name", self.name],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                env={**os.environ, **dict.fromkeys(THREADS, "1")},
                start_new_session=True,  # Ctrl-C goes to this process, which ends the worker
            )
        self._watched = WatchedProcess(process.pid)
        return process


def end(process: subprocess.Popen[bytes]) -> None:
    """Wait for a process to end; kill it if it does not."""
    if process.stdin is not None:
        process.stdin.close()
    try:
        process.wait(ANSWER_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@contextmanager
def shared_pool(pool: Pool) -> Iterator[tuple[str, LocalWorker]]:
    """One pool for several runs: a router within this process, and the local worker behind it.

    Other workers may join as defined by `pool`. Yields the endpoint for the runs, and the local worker.
    """
    with private_folder() as name:
        folder = Path(name)
        local = f"{LOCAL}/{folder / 'bus'}"
        with open_router([local, *pool.listen_endpoints], pool.connect_endpoints, pool.security) as bus:
            worker = LocalWorker(pool, f"shared-{uuid.uuid4().hex[:12]}", bus, local, folder)
            try:
                yield local, worker
            finally:
                worker.stop()
