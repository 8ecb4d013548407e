"""A frozen local worker is told from one that gets no processor, with real processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from gepf.coordinator.pool.local_worker import LocalWorker, LocalWorkerLimits
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.watched_process import WatchedProcess
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from tests.support.processes.programs import wait_until
from tests.support.processes.serving import expected, refined_bytes

SPIN = "while True: pass"
DEADLOCK = "import threading; lock = threading.Lock(); lock.acquire(); print(flush=True); lock.acquire()"
WATCHED_S = 2.0


@contextmanager
def running(code: str) -> Iterator[subprocess.Popen[str]]:
    """Python code as a process."""
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def starve(pid: int) -> ExitStack:
    """Leave a process one processor, and that to another process that never rests; ends with the stack."""
    with ExitStack() as stack:
        cpu = min(os.sched_getaffinity(0))
        hog = stack.enter_context(running(SPIN))
        os.sched_setaffinity(hog.pid, {cpu})
        os.sched_setscheduler(pid, os.SCHED_IDLE, os.sched_param(0))
        group = Path(f"/proc/{pid}/autogroup")
        if os.getsid(pid) != os.getsid(0) and group.exists():  # sessions share processors, see sched(7)
            group.write_text("10")
        os.sched_setaffinity(pid, {cpu})
        return stack.pop_all()


def share_able(pid: int) -> float:
    """The share of some seconds in which a process was able to run."""
    watched, able, began = WatchedProcess(pid), 0.0, time.monotonic()
    watched.able_since(began)
    while (now := time.monotonic()) < began + WATCHED_S:
        time.sleep(0.05)
        able += watched.able_since(time.monotonic())
    return able / (now - began)


def test_a_process_that_gets_no_processor_was_not_able_to_run() -> None:
    """One that wants to run beside another that takes the processor is not to blame for its silence."""
    with running(SPIN) as process, starve(process.pid):
        assert share_able(process.pid) < 0.5


def test_stopped_and_deadlocked_processes_were_able_to_run() -> None:
    """Whatever they do not do, nothing but they themselves kept them from it, on a busy machine, too."""
    with running(SPIN) as stopped, running(DEADLOCK) as locked:
        assert locked.stdout is not None
        locked.stdout.readline()
        stopped.send_signal(signal.SIGSTOP)
        with starve(locked.pid), starve(stopped.pid):
            time.sleep(0.2)  # for the lock to be waited for
            wait_until(lambda: share_able(locked.pid) > 0.9)
            assert share_able(stopped.pid) > 0.9


def test_an_ended_process_says_nothing() -> None:
    """A process that is gone has no time, and is no error."""
    with running("") as process:
        process.wait()
        watched = WatchedProcess(process.pid)
    assert [watched.able_since(now) for now in (0.0, 1.0)] == [0.0, 0.0]


class Presence:
    """A bus that sees the worker when it is told to."""

    def watch(self, _key: str, on_change: Callable[[str, bool], None]) -> None:
        """Keep the watcher."""
        self.tell = on_change


def test_a_starved_worker_is_not_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that the bus loses while others take the processor goes on; frozen, it is killed and replaced."""
    monkeypatch.setattr("gepf.coordinator.pool.local_worker.LIMITS", LocalWorkerLimits(absence_s=1.0))
    bus, command = Presence(), (sys.executable, "-c", SPIN)
    worker = LocalWorker(Pool(1, worker_command=command), "w", bus, "nowhere", tmp_path)  # type: ignore[arg-type]
    assert worker.process is not None
    pid = worker.process.pid

    def look() -> str | None:
        time.sleep(0.05)
        return worker.look_after(time.monotonic())

    try:
        bus.tell("", True)
        look()
        with starve(pid):
            bus.tell("", False)
            began = time.monotonic()
            while time.monotonic() < began + 3.0:
                assert look() is None
            os.kill(pid, signal.SIGSTOP)
            wait_until(lambda: look() is not None)
        assert worker.process.pid != pid
    finally:
        worker.stop()


HANGS_ONCE = """
import sys, threading
from pathlib import Path
from tests.support.processes import instant_worker
refine, asked = instant_worker.refine, Path(sys.argv.pop(1))
def hang(*args, **options):
    if not asked.exists():
        asked.touch()
        lock = threading.Lock()
        lock.acquire()
        lock.acquire()
    return refine(*args, **options)
instant_worker.refine = hang
instant_worker.main()
"""


def test_a_deadlocked_worker_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bus sees it, but it answers nothing: it is killed, and its request is answered by the next one."""
    monkeypatch.setattr("gepf.coordinator.pool.local_worker.LIMITS", LocalWorkerLimits(silence_s=1.0))
    said: list[str] = []
    command = (sys.executable, "-c", HANGS_ONCE, str(tmp_path / "asked"))
    with ZenohRefiner(Pool(1, worker_command=command), said.append) as refiner:
        assert refined_bytes(refiner, 0) == expected(0)
        assert refiner.statistics.counts["local_workers_restarted"] == 1
    assert any("was ended by SIGKILL; starting it again" in line for line in said)
