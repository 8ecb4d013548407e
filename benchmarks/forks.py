"""Jobs in processes of their own, a few at a time: one that dies takes no other with it."""

from __future__ import annotations

import multiprocessing
import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkProcess
from typing import Any, TypeVar

from coordinator.pool.local_workers import describe_end

J = TypeVar("J")
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Crash:
    """A job that came to no result."""

    error: str  # one line
    trace: str = ""


def run_forked(work: Callable[[J], R], jobs: Iterable[J], processes: int) -> Iterator[tuple[J, R | Crash]]:
    """Each job with its result as soon as that is there. A process starts with all that is in memory now."""
    waiting, running = deque(jobs), dict[Connection, tuple[ForkProcess, J]]()
    try:
        while waiting or running:
            while waiting and len(running) < processes:
                job = waiting.popleft()
                process, results = start(work, job)
                running[results] = process, job
            ready = wait(list(running))
            for results in [r for r in running if r in ready]:
                process, job = running.pop(results)
                found: R | Crash = collect(process, results)
                yield job, found
    finally:
        for process, _ in running.values():
            process.terminate()
            process.join()


def start(work: Callable[[J], R], job: J) -> tuple[ForkProcess, Connection]:
    """A process at work, and where its result will come from."""
    results, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("fork").Process(target=do, args=(work, job, sender), daemon=True)
    process.start()
    sender.close()  # ours; when the process ends, nobody holds the other end
    return process, results


def do(work: Callable[[J], R], job: J, sender: Connection) -> None:
    """What the process does. An interrupt from the keyboard is for the parent, which ends us."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        result: R | Crash = work(job)
    except Exception as error:  # noqa: BLE001 whatever it is, it is reported
        line = " ".join(f"{type(error).__name__}: {error}".split())
        result = Crash(line, "".join(traceback.format_exception(error)))
    sender.send(result)


def collect(process: ForkProcess, results: Connection) -> Any:
    """What the process sent, or how it ended before it could."""
    with results:
        try:
            return results.recv()
        except EOFError:
            process.join()
            return Crash(f"its process {describe_end(process.exitcode or 0)}")
        finally:
            process.join()
