"""Several recordings over one pool: as many runs at once as keep it busy, and one table at the end."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess

from coordinator.commands.batch.process import Report, track_one
from coordinator.commands.batch.table import tabulate
from coordinator.commands.console.progress import Advance, Show
from coordinator.commands.exit_codes import DONE, FAILED, INPUT_AT_FAULT, INTERRUPTED
from coordinator.commands.options.job import Job
from coordinator.pool.shared import SharedPool, shared_pool

LOOK = 0.5  # seconds between looks for workers that have died
CONTEXT = multiprocessing.get_context("forkserver")


@dataclass(slots=True, eq=False)
class Running:
    """One run that is under way."""

    job: Job
    process: BaseProcess
    pipe: Connection
    lines: list[str] = field(default_factory=list)
    done: int = 0
    began: float = field(default_factory=time.monotonic)


@dataclass(frozen=True, slots=True)
class Ended:
    """How one run ended: its exit code, the last thing that it said, and how long it took."""

    job: Job
    code: int
    line: str
    seconds: float


def track_many(jobs: Sequence[Job], at_once: int | None, show: Show) -> int:
    """Track all; gives the exit code: the gravest of all runs. Bytes are as if each had a pool of its own.

    One that fails stops no other. An interrupt ends all; their frames are kept, for `--resume`.
    """
    place = {job.out: at for at, job in enumerate(jobs)}
    ended = sorted(run_pool(jobs, at_once, show), key=lambda each: place[each.job.out])
    for line in tabulate([(e.job, e.code, e.line, e.seconds) for e in ended]):
        show.say(line)
    return gravest([each.code for each in ended])


def run_pool(jobs: Sequence[Job], at_once: int | None, show: Show) -> list[Ended]:
    """Track all over one pool, as many at once as keep it busy; how each ended, in that order."""
    pool = jobs[0].pool
    limit = at_once or runs_at_once(pool.lanes)
    show.say(f"tracking {len(jobs)} recordings, {min(limit, len(jobs))} at once, into {jobs[0].out.parent}")
    with shared_pool(pool) as shared, show.steps("recordings") as advance:
        return list(run_all(jobs, limit, shared, show, advance))


def runs_at_once(lanes: int) -> int:
    """So many that each lane has work while some of the runs are between two frames."""
    return max(2, lanes + 1)


def run_all(
    jobs: Sequence[Job], limit: int, shared: SharedPool, show: Show, advance: Advance
) -> Iterator[Ended]:
    """Start runs as others end, in order; gives each as it ends."""
    CONTEXT.set_forkserver_preload(["coordinator.commands.batch.process"])
    running: list[Running] = []
    waiting, total = list(jobs), len(jobs)
    with ending(running):
        advance(0, total)
        while waiting or running:
            while waiting and len(running) < limit:
                running.append(start(waiting.pop(0), shared))
            for line in shared.workers.restart_dead():
                show.say(line)
            for run in listen(running, show):
                running.remove(run)
                yield conclude(run, show)
                advance(total - len(waiting) - len(running), total)


def start(job: Job, shared: SharedPool) -> Running:
    """Begin a run in a process of its own."""
    ours, theirs = CONTEXT.Pipe(duplex=False)
    process = CONTEXT.Process(target=track_one, args=(replace(job, pool=shared.of_a_run()), theirs))
    process.start()
    theirs.close()
    return Running(job, process, ours)


def listen(running: Sequence[Running], show: Show) -> list[Running]:
    """Hear what runs say, for a moment; gives those that have ended."""
    pipes: dict[object, Running] = {run.pipe: run for run in running}
    ended: list[Running] = []
    for pipe in wait([run.pipe for run in running], LOOK):
        run = pipes[pipe]
        try:
            note(run, run.pipe.recv(), show)
        except EOFError:
            ended.append(run)
    return ended


def note(run: Running, report: Report, show: Show) -> None:
    """Keep what a run says, and pass its lines on under its name."""
    if report.line:
        run.lines.append(report.line)
        show.say(f"{run.job.out.name}: {report.line}")
    else:
        run.done = report.done


def conclude(run: Running, show: Show) -> Ended:
    """What is left of a run that has ended."""
    run.process.join()
    run.pipe.close()
    code = run.process.exitcode
    code = FAILED if code is None or code < 0 else code
    if code != DONE:
        show.say(f"{run.job.out.name}: ended with exit code {code}")
    return Ended(run.job, code, run.lines[-1] if run.lines else "", time.monotonic() - run.began)


@contextmanager
def ending(running: Sequence[Running]) -> Iterator[None]:
    """Let no run outlive the context: each is interrupted, and given time to keep its frames."""
    try:
        yield
    finally:
        for run in running:
            if run.process.pid is not None and run.process.is_alive():
                os.kill(run.process.pid, signal.SIGINT)
        for run in running:
            run.process.join()


def gravest(codes: Sequence[int]) -> int:
    """One exit code for all: interrupted, then failed, then input at fault, then whatever is not done."""
    for code in (INTERRUPTED, FAILED, INPUT_AT_FAULT):
        if code in codes:
            return code
    return max(codes, default=DONE)
