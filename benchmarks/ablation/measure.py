"""Try every row on every recording and seed, go on where a run was broken off, and tell what came of it."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console

from benchmarks.ablation.effects import Effect, effects_of
from benchmarks.ablation.rows import choose_rows
from benchmarks.ablation.table import markdown, write_into
from benchmarks.ablation.trials import Trial, try_all
from benchmarks.costs.timing import machine
from benchmarks.forks import Crash, run_forked
from benchmarks.people import keep
from benchmarks.sequences import Recording, find_people
from benchmarks.tracking import prepare
from common.errors import InputError
from common.settings import PRESETS, Settings
from coordinator.results.configuration import versions

Job = tuple[int, Recording]
"""A seed and a recording."""


@dataclass(frozen=True, slots=True)
class Choice:
    """What to measure."""

    data: Path
    subjects: Sequence[int]
    actions: Sequence[int]
    only: Sequence[str] | None
    every: int
    frames: int
    seeds: int
    minutes: float | None
    out: Path
    into: Path | None


class Ablation(msgspec.Struct, frozen=True):
    """All that was tried, and what each change is worth."""

    settings: Settings
    every: int
    frames: int  # of each recording
    versions: dict[str, str]
    machine: dict[str, str]
    trials: list[Trial]
    effects: list[Effect]


def measure(choice: Choice) -> int:
    """Exit code: 1 if a recording crashed. InputError for what makes no sense."""
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    rows = choose_rows(choice.only)
    trials = finished(choice)
    known = {(trial.seed, trial.recording) for trial in trials}
    jobs = [job for job in choose_jobs(choice) if (job[0], job[1].name) not in known]
    console.print(f"{len(known)} recordings are done, {len(jobs)} to go; loading kernels and bodies")
    bodies, crashed = prepare(), False
    for job in until(choice.minutes, jobs):
        result = alone(lambda job: try_all(job[1], job[0], rows, choice.every, choice.frames, bodies), job)
        if isinstance(result, Crash):
            crashed = True
            console.print(f"{job[1].name} seed {job[0]} crashed: {result.error}\n{result.trace}")
        else:
            trials = [*trials, *result]
            keep(summarise(choice, trials), choice.out)
            console.print(f"{job[1].name:<7} seed {job[0]}  {result[0].percent:5.1f} %")
    return tell(choice, trials) or int(crashed)


def alone(work: Callable[[Job], list[Trial]], job: Job) -> list[Trial] | Crash:
    """A job's result, in a process of its own."""
    return next(result for _, result in run_forked(work, [job], processes=1))


def finished(choice: Choice) -> list[Trial]:
    """The trials of the file, none if there is none; InputError if they are of other settings or frames."""
    if not choice.out.is_file():
        return []
    try:
        before = msgspec.json.decode(choice.out.read_bytes(), type=Ablation)
    except msgspec.DecodeError as error:
        raise InputError(
            f"{choice.out} is no result of this benchmark; give another file with --out"
        ) from error
    rows = {row.name for row in choose_rows(choice.only)}
    same = (before.settings, before.every, before.frames, {one.row for one in before.effects}) == (
        PRESETS["default"], choice.every, choice.frames, rows
    )  # fmt: skip
    if not same:
        raise InputError(
            f"{choice.out} holds trials of other settings, rows or frames; give another file with --out"
        )
    return before.trials


def choose_jobs(choice: Choice) -> list[Job]:
    """Every recording with the first seed, then with the next; InputError where there are none."""
    subjects = {f"s{subject}" for subject in choice.subjects}
    found = [
        recording
        for recording in find_people(choice.data / "utd_mhad")
        if recording.action in choice.actions and recording.name.rpartition("_")[2] in subjects
    ]
    if not found:
        raise InputError(f"{choice.data} holds no such recordings of UTD-MHAD; give the folder with --data")
    return [(seed, recording) for seed in range(choice.seeds) for recording in found]


def until(minutes: float | None, jobs: Sequence[Job]) -> Iterator[Job]:
    """The jobs that begin within so many minutes."""
    began = time.monotonic()
    for job in jobs:
        if minutes is None or time.monotonic() - began < 60.0 * minutes:
            yield job


def summarise(choice: Choice, trials: list[Trial]) -> Ablation:
    """Put together what was measured."""
    return Ablation(
        settings=PRESETS["default"],
        every=choice.every,
        frames=choice.frames,
        versions=versions(),
        machine=machine(),
        trials=trials,
        effects=effects_of(trials, [row.name for row in choose_rows(choice.only)]),
    )


def tell(choice: Choice, trials: list[Trial]) -> int:
    """Print the table; exit code 1 if there is nothing to tell."""
    if not trials:
        return 1
    lines = list(markdown(effects_of(trials, [row.name for row in choose_rows(choice.only)])))
    sys.stdout.write("\n".join(lines) + "\n")
    if choice.into is not None:
        write_into(choice.into, lines)
    return 0
