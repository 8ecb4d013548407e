"""Several recordings with one pool: one process per run, and as many at once as keep the pool busy.

The processes are forked from one that has loaded all libraries, so they start immediately.
"""

from __future__ import annotations

import csv
import io
import logging
import math
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from rich.console import Console
from rich.progress import TaskID
from rich.table import Table

from gepf.common.errors import InputError
from gepf.coordinator.commands.console import INTERRUPTS, ExitCode, exit_code
from gepf.coordinator.commands.job import Job
from gepf.coordinator.commands.progress import Advance, Show, bars_on
from gepf.coordinator.commands.track import track
from gepf.coordinator.files import write_atomically
from gepf.coordinator.pool.local_worker import shared_pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.coordinator.results.summary import read_summary
from gepf.coordinator.results.tally import STATUSES
from gepf.coordinator.sources.rig import live_cameras

CONTEXT = multiprocessing.get_context("forkserver")
TABLE_FILE = "runs.csv"
FACTS = ("digest", "frames", "seconds", "frame_rate")  # of a summary; statuses follow


class SentShow(Show):
    """The progress of a run, sent to the process that shows all runs."""

    def __init__(self, pipe: Connection) -> None:
        super().__init__(Console(quiet=True))
        self._pipe = pipe

    def say(self, text: str, style: str | None = None) -> None:  # noqa: ARG002 has no styles
        """Send one line."""
        self._pipe.send(text)

    @contextmanager
    def steps(
        self,
        label: str,
        done: int = 0,
        total: int | None = None,
        *,
        keep: bool = False,  # noqa: ARG002 keeps none
    ) -> Iterator[Advance]:
        """Send the state of a task at its start, and from time to time."""
        self._pipe.send((done, total, label))
        sent = -math.inf

        def advance(done: int, total: int | None, detail: str = "") -> None:
            nonlocal sent
            INTERRUPTS.check()
            if time.monotonic() - sent > 0.2:
                self._pipe.send((done, total, detail or label))
                sent = time.monotonic()

        yield advance


class Dashboard:
    """One line per run on a terminal, and what the runs say above these lines."""

    def __init__(self, show: Show, *, quiet: bool) -> None:
        self._show, self.bars = show, bars_on(show.console, hidden=quiet)
        self._names = dict[Connection, tuple[str, TaskID]]()

    def open(self, name: str) -> Connection | None:
        """Where a run sends its progress; None if there are no lines for it."""
        if self.bars.disable:
            return None
        mine, theirs = CONTEXT.Pipe(duplex=False)
        self._names[mine] = name, self.bars.add_task(name, total=None)
        return theirs

    def wait(self, sentinels: Sequence[int]) -> None:
        """Show what comes next, or wait until a process ends; half a second at most."""
        wait([*sentinels, *self._names], 0.5)
        self.show_all()

    def show_all(self) -> None:
        """Show what has come."""
        for pipe, (name, task) in list(self._names.items()):
            try:
                while pipe.poll():
                    match pipe.recv():
                        case str(text):
                            self._show.say(f"{name}: {text}")
                        case done, total, detail:
                            text = f"{name}: {detail}"
                            self.bars.update(task, completed=done, total=total, description=text)
            except EOFError:  # the run has ended
                del self._names[pipe]
                self.bars.remove_task(task)


@dataclass(frozen=True, slots=True)
class Ended:
    """The exit code of one run, and its duration."""

    job: Job
    code: int
    seconds: float

    @property
    def is_done(self) -> bool:
        """Whether it has results, although most frames may not be tracked."""
        return self.code in (ExitCode.DONE, ExitCode.NOT_TRACKED)


def choose_runs(job: Job, paths: Sequence[Path]) -> list[Job]:
    """One run per recording, which continues what is in its folder; InputError for equal names."""
    if any(map(live_cameras, paths)):
        raise InputError("live input is tracked alone; give zenoh:KEY or a rig, and nothing else")
    whole = [path.resolve() for path in paths]
    names = [each.name if each.is_dir() else each.stem for each in whole]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"two recordings have the name '{twice[0]}'; track them into different folders")
    folders = [job.folder / name for name in names]
    return [
        replace(job, sequence=path, out=folder, resume=job.resume or folder.exists())
        for path, folder in zip(paths, folders, strict=True)
    ]


def track_many(jobs: Sequence[Job], show: Show) -> int:
    """Track all, show a table and write it as runs.csv; returns the most severe exit code: 130, then 1, 2, 3.

    The results are the same, bit for bit, as those of single runs. A finished run with the same input and
    settings is not tracked again; a run that was stopped is continued. A run that fails does not stop the
    others. An interrupt ends all runs; their frames are kept.
    """
    show.say(f"tracking {len(jobs)} recordings into {jobs[0].folder.parent}")
    ended = run_pool(jobs, show, quiet=show.console.quiet)
    table = Table("recording", "frames", "tracked", "seconds", "", box=None)
    for run in ended:
        table.add_row(*row_of(run))
    show.console.print(table)
    write_table(jobs[0].folder.parent / TABLE_FILE, ended)
    codes = [run.code for run in ended if run.code]
    return ExitCode.INTERRUPTED if ExitCode.INTERRUPTED in codes else min(codes, default=0)


def run_pool(jobs: Sequence[Job], show: Show, *, quiet: bool) -> list[Ended]:
    """Track all runs with one pool; returns how each ended. With `quiet`, they report only errors."""
    pool, ended = jobs[0].pool, dict[Path, Ended]()
    running = dict[ForkServerProcess, tuple[Job, float]]()  # the run of each process, and when it began
    limit = max(2, pool.lanes + 1)  # lanes have work while a run is between two frames
    waiting, dashboard = list(reversed(jobs)), Dashboard(show, quiet=quiet)
    CONTEXT.set_forkserver_preload([__name__])
    with shared_pool(pool) as (endpoint, worker), dashboard.bars:
        try:
            while waiting or running:
                while waiting and len(running) < limit:
                    job = waiting.pop()
                    of_run = replace(job, pool=replace(pool, shared_at=endpoint))
                    pipe = dashboard.open(job.folder.name)
                    process = CONTEXT.Process(target=track_one, args=(of_run, quiet, pipe))
                    process.start()
                    if pipe is not None:
                        pipe.close()
                    running[process] = job, time.monotonic()
                line = worker.look_after(time.monotonic())
                if line is not None:
                    show.say(line)
                dashboard.wait([process.sentinel for process in running])
                for process in [each for each in running if not each.is_alive()]:
                    dashboard.show_all()
                    (job, began), code = running.pop(process), process.exitcode
                    code = 1 if code is None or code < 0 else code  # a signal killed it
                    ended[job.folder] = Ended(job, code, time.monotonic() - began)
                    how = f"ended with exit code {code}" if code else "done"
                    show.say(f"{job.folder.name}: {how}, {len(ended)} of {len(jobs)}")
        finally:
            for process in running:
                process.terminate()
            for process in running:  # their frames are kept
                process.join()
    return [ended[job.folder] for job in jobs]


def row_of(run: Ended) -> tuple[str, ...]:
    """The row of one run in the table."""
    name, took = run.job.folder.name, f"{run.seconds:.1f}"
    if not run.is_done:
        return name, "-", "-", took, f"exit code {run.code}"
    summary = read_summary(run.job.folder)
    tracked = f"{100 * summary['status'].get('tracked', 0) / max(summary['frames'], 1):.0f} %"
    return name, str(summary["frames"]), tracked, took, "most frames are not tracked" if run.code else ""


def write_table(file: Path, ended: Sequence[Ended]) -> None:
    """Write one line per run as CSV: its exit code and, unless it failed, facts of its summary."""
    text = io.StringIO(newline="")
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("recording", "folder", "exit_code", *FACTS, *STATUSES))
    for run in ended:
        summary = read_summary(run.job.folder) if run.is_done else {}
        facts = [summary.get(name, "") for name in FACTS]
        counts = [summary["status"].get(name, 0) if summary else "" for name in STATUSES]
        rows.writerow((run.job.sequence, run.job.folder, run.code, *facts, *counts))
    write_atomically(file, lambda opened: opened.write(text.getvalue().encode()))


def track_one(job: Job, quiet: bool, pipe: Connection | None) -> None:
    """The main function of a process: track one run, and exit with the code that `gepf track` would have.

    Its progress goes to the pipe or, without one, to the log.
    """
    os.setpgid(0, 0)  # Ctrl-C is handled by the parent process, which then ends this one
    end_with_parent()
    name = job.folder.name
    logging.basicConfig(format=f"{name}: %(message)s", level=logging.WARNING, force=True)
    console = Console(stderr=True, quiet=quiet, force_terminal=False)
    show = Show(console, quiet_seconds=math.inf, name=f"{name}: ") if pipe is None else SentShow(pipe)

    def work() -> int:
        return ExitCode.DONE if track(job, show, ZenohRefiner) else ExitCode.NOT_TRACKED

    sys.exit(exit_code(work, name))


def end_with_parent() -> None:
    """Interrupt this process when its parent process ends for any reason."""
    parent = multiprocessing.parent_process()

    def interrupt_after(sentinel: int) -> None:
        wait([sentinel])
        os.kill(os.getpid(), signal.SIGTERM)

    if parent is not None:
        threading.Thread(target=interrupt_after, args=(parent.sentinel,), daemon=True).start()
