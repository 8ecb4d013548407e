"""Several recordings over one pool: as many runs at once as keep it busy, and one table at the end.

Each run has a process of its own, forked from one that has loaded all libraries so that it starts at once.
"""

from __future__ import annotations

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
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

import msgspec
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
from coordinator.commands.evaluate import own_truth_file
from coordinator.commands.job import Job, at_least, is_list
from coordinator.commands.progress import Advance, FrameMeter, Show
from coordinator.commands.track import track
from coordinator.commands.track_options import TrackOptions
from coordinator.commands.workers import connect_workers
from coordinator.pool.local_workers import SharedPool, shared_pool
from coordinator.results.evaluation import evaluate, read_truth
from coordinator.results.summary import SUMMARY_FILE, read_summary
from coordinator.results.track import read_track
from coordinator.sources.live import live_key

HEADS = ("recording", "frames", "tracked", "seconds", "joint error", "")
UNKNOWN = "-"
LOOK_S = 0.5  # between looks for workers that have died
MOST_SEEDS = 10_000
CONTEXT = multiprocessing.get_context("forkserver")


@dataclass(frozen=True, slots=True)
class Entry:
    """One run of several: what is tracked, the folder's name within `--out`, the seed."""

    sequence: Path
    name: str
    seed: int


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
    CONTEXT.set_forkserver_preload(["coordinator.commands.many"])
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


def choose_entries(sequences: Sequence[Path], seed: int, seeds: str | None) -> list[Entry]:
    """A run for each recording and seed. InputError for a list that cannot be read, and for equal names."""
    paths = [path for given in sequences for path in (read_list(given) if is_list(given) else [given])]
    whole = [path.resolve() for path in paths]
    names = [each.name if each.is_dir() else each.stem for each in whole]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"two recordings are called '{twice[0]}'; track them into folders of their own")
    chosen = parse_seeds(seeds) if seeds is not None else range(seed, seed + 1)
    return [
        Entry(path, name if seeds is None else f"{name}-seed{number}", number)
        for path, name in zip(paths, names, strict=True)
        for number in chosen
    ]


def read_list(file: Path) -> Sequence[Path]:
    """The recordings of a list: one a line, as seen from the file's folder; # begins a comment."""
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:
        raise InputError(f"cannot read {file}: {error}; give a text file with a recording a line") from None
    found = [file.parent / text for line in lines if (text := line.split("#", 1)[0].strip())]
    if not found:
        raise InputError(f"{file} lists nothing; write one recording a line")
    return found


def parse_seeds(text: str) -> range:
    """Seeds A to before B of `A:B`."""
    first, colon, end = text.partition(":")
    if not (colon and first.strip().isdecimal() and end.strip().isdecimal()):
        raise InputError(f"--seeds '{text}' is not of the form A:B; 0:5 stands for 0, 1, 2, 3 and 4")
    seeds = range(int(first), int(end))
    if not 0 < len(seeds) <= MOST_SEEDS:
        raise InputError(f"--seeds {text} holds {len(seeds)} seeds; give 1 to {MOST_SEEDS}")
    return seeds


class DistantShow(Show):
    """Lines that another process shows."""

    def __init__(self, pipe: Connection) -> None:
        super().__init__(Console(quiet=True), quiet_seconds=math.inf)
        self._pipe = pipe

    def say(self, text: str) -> None:
        """Send a line, if the other process still listens."""
        with suppress(OSError):
            self._pipe.send(text)

    warn = say

    def frames(self, total: int | None, done: int = 0) -> FrameMeter:
        """A meter that shows nothing."""
        return FrameMeter(total, done)


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

    def interrupt_after(sentinel: int) -> None:
        wait([sentinel])
        os.kill(os.getpid(), signal.SIGINT)

    if parent is not None:
        threading.Thread(target=interrupt_after, args=(parent.sentinel,), daemon=True).start()


class PipeHandler(logging.Handler):
    """Sends warnings as lines."""

    def __init__(self, show: DistantShow) -> None:
        super().__init__(logging.WARNING)
        self._show = show

    def emit(self, record: logging.LogRecord) -> None:
        """Send one."""
        self._show.say(record.getMessage())
