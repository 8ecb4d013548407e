"""Several recordings over one pool: as many runs at once as keep it busy, and one table at the end."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import msgspec

from common.errors import InputError
from coordinator.commands.console import DONE, FAILED, INPUT_AT_FAULT, INTERRUPTED
from coordinator.commands.evaluate import own_truth_file
from coordinator.commands.job import Job, at_least
from coordinator.commands.many_process import track_one
from coordinator.commands.many_recordings import choose_entries
from coordinator.commands.progress import Advance, Show
from coordinator.commands.track_options import TrackOptions
from coordinator.pool.local_workers import SharedPool, shared_pool
from coordinator.results.evaluation import evaluate, read_truth
from coordinator.results.summary import SUMMARY_FILE, read_summary
from coordinator.results.track import read_track
from coordinator.sources.live import live_key

HEADS = ("recording", "frames", "tracked", "seconds", "joint error", "")
UNKNOWN = "-"
LOOK_S = 0.5  # between looks for workers that have died
CONTEXT = multiprocessing.get_context("forkserver")


@dataclass(slots=True, eq=False)
class Running:
    """One run that is under way."""

    job: Job
    process: BaseProcess
    pipe: Connection
    lines: list[str] = field(default_factory=list)
    began: float = field(default_factory=time.monotonic)


@dataclass(frozen=True, slots=True)
class Ended:
    """How one run ended: its exit code, the last thing that it said, and how long it took."""

    job: Job
    code: int
    line: str
    seconds: float


def track_recordings(options: TrackOptions, job: Job, show: Show) -> int:
    """Track each recording with each seed as `job` says, over one pool; gives the exit code."""
    at_once = options.pool.at_once
    entries = choose_entries(options.input.sequences, options.method.seed, options.method.seeds)
    if any(live_key(entry.sequence) is not None for entry in entries):
        raise InputError("live input is tracked alone; give zenoh:KEY and nothing else")
    if at_once is not None:
        at_least(1, "--at-once", at_once)
    jobs = [
        replace(
            job,
            sequence=entry.sequence,
            out=job.out / entry.name,
            settings=msgspec.structs.replace(job.settings, seed=entry.seed),
        )
        for entry in entries
    ]
    code = track_many(jobs, at_once, show)
    if options.output.as_json:
        found = [each.out / SUMMARY_FILE for each in jobs]
        texts = [file.read_text(encoding="utf-8").strip() for file in found if file.exists()]
        sys.stdout.write("[" + ",\n".join(texts) + "]\n")
    return code


def track_many(jobs: Sequence[Job], at_once: int | None, show: Show) -> int:
    """Track all; gives the exit code: the gravest of all runs. Bytes are as if each had a pool of its own.

    One that fails stops no other. An interrupt ends all; their frames are kept, for `--resume`.
    """
    place = {job.out: at for at, job in enumerate(jobs)}
    ended = sorted(run_pool(jobs, at_once, show), key=lambda each: place[each.job.out])
    for line in tabulate(ended):
        show.say(line)
    return gravest([each.code for each in ended])


def run_pool(jobs: Sequence[Job], at_once: int | None, show: Show) -> list[Ended]:
    """Track all over one pool, as many at once as keep it busy; how each ended, in that order."""
    pool = jobs[0].pool
    limit = at_once or max(2, pool.lanes + 1)  # each lane has work while a run is between two frames
    show.say(f"tracking {len(jobs)} recordings, {min(limit, len(jobs))} at once, into {jobs[0].out.parent}")
    with shared_pool(pool) as shared, show.steps("recordings") as advance:
        return list(run_all(jobs, limit, shared, show, advance))


def run_all(
    jobs: Sequence[Job], limit: int, shared: SharedPool, show: Show, advance: Advance
) -> Iterator[Ended]:
    """Start runs as others end, in order; gives each as it ends."""
    CONTEXT.set_forkserver_preload(["coordinator.commands.many_process"])
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
    for pipe in wait([run.pipe for run in running], LOOK_S):
        run = pipes[pipe]
        try:
            line: str = run.pipe.recv()
        except EOFError:
            ended.append(run)
            continue
        run.lines.append(line)
        show.say(f"{run.job.out.name}: {line}")
    return ended


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


def tabulate(runs: Sequence[Ended]) -> list[str]:
    """Lines of a table: name, frames, share that is tracked, seconds, joint error where a truth is there."""
    rows = [HEADS, *map(cells_of, runs)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *numbers, last in rows:
        middle = "  ".join(cell.rjust(width) for cell, width in zip(numbers, widths[1:-1], strict=True))
        lines.append(f"{first.ljust(widths[0])}  {middle}  {last}".rstrip())
    return lines


def cells_of(run: Ended) -> tuple[str, ...]:
    """One run's row; of one that left no results, why."""
    out, took = run.job.out, f"{run.seconds:.1f}"
    if run.code:
        return (out.name, UNKNOWN, UNKNOWN, took, UNKNOWN, f"exit code {run.code}: {run.line}")
    summary = read_summary(out)
    tracked = f"{100 * summary['status'].get('tracked', 0) / max(summary['frames'], 1):.0f} %"
    return (out.name, str(summary["frames"]), tracked, took, joint_error(out), "")


def joint_error(run: Path) -> str:
    """Mean joint error in centimetres, where the sequence comes with its truth."""
    truth = own_truth_file(run)
    try:
        error = None if truth is None else evaluate(read_track(run), read_truth(truth)).mean_joint_error_cm
    except InputError:
        error = None
    return UNKNOWN if error is None else f"{error:.1f} cm"
