"""Track the chosen recordings at the chosen frame rates, row by row."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console

from benchmarks.costs.timing import machine
from benchmarks.forks import Crash, run_forked
from benchmarks.frame_rates.picture import draw
from benchmarks.frame_rates.rows import HARD_ACTIONS, Row, choose_rows
from benchmarks.frame_rates.scores import RowScore, score_row, score_table
from benchmarks.frame_rates.trials import Compared, stand_still, track_thinned
from benchmarks.people import WIDTH, keep
from benchmarks.sequences import Recording, find_people
from benchmarks.tracking import prepare
from common.errors import InputError
from coordinator.bodies.tracked import Bodies
from coordinator.results.configuration import versions
from coordinator.sources.utd_mhad import FPS


@dataclass(frozen=True, slots=True)
class Choice:
    """What to measure."""

    data: Path
    every: Sequence[int]
    subjects: Sequence[int]
    actions: Sequence[int] | None
    rows: Sequence[str] | None
    changes: Sequence[str]
    seeds: int
    processes: int
    out: Path | None
    picture: Path | None


@dataclass(frozen=True, slots=True)
class Trial:
    """One recording, tracked once."""

    row: Row
    every: int
    seed: int
    recording: Recording


class Report(msgspec.Struct, frozen=True):
    """One run of the benchmark."""

    subjects: list[int]
    actions: list[int]
    changes: list[str]
    seeds: int
    versions: dict[str, str]
    machine: dict[str, str]
    scores: list[RowScore]


def measure(choice: Choice) -> int:
    """Exit code: 1 if a recording crashed. InputError for what makes no sense."""
    rows = choose_rows(choice.rows)
    recordings = choose_recordings(choice)
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    console.print("loading kernels and bodies")
    bodies = prepare()
    scores: list[RowScore] = []
    for every in choice.every:
        for row in rows:
            scores.append(run_row(row, every, recordings, choice, bodies))
            console.print(f"every {every}  {row.name:<24} {scores[-1].uncontradicted}")
    report = Report(
        subjects=list(choice.subjects),
        actions=list(choice.actions or HARD_ACTIONS),
        changes=list(choice.changes),
        seeds=choice.seeds,
        versions=versions(),
        machine=machine(),
        scores=scores,
    )
    title = f"UTD-MHAD, subjects {' '.join(map(str, choice.subjects))}, mean of {choice.seeds} seeds"
    Console(width=None if sys.stdout.isatty() else WIDTH).print(score_table(scores, title))
    if choice.out is not None:
        keep(report, choice.out)
    if choice.picture is not None:
        draw(scores, choice.picture)
    return 1 if any(score.crashes for score in scores) else 0


def choose_recordings(choice: Choice) -> list[Recording]:
    """Those of the subjects and actions; InputError where there are none."""
    actions = choice.actions or HARD_ACTIONS
    subjects = {f"s{subject}" for subject in choice.subjects}
    found = [
        recording
        for recording in find_people(choice.data / "utd_mhad")
        if recording.action in actions and recording.name.rpartition("_")[2] in subjects
    ]
    if not found:
        raise InputError(f"{choice.data} holds no such recordings of UTD-MHAD; give the folder with --data")
    return found


def run_row(
    row: Row, every: int, recordings: Sequence[Recording], choice: Choice, bodies: Bodies
) -> RowScore:
    """All recordings and seeds of one row, each in a process of its own."""
    seeds = choice.seeds if row.draws else 1
    trials = [Trial(row, every, seed, recording) for seed in range(seeds) for recording in recordings]
    compared: dict[int, list[Compared]] = {seed: [] for seed in range(seeds)}
    crashes: list[str] = []
    finished = run_forked(lambda trial: run(trial, choice.changes, bodies), trials, choice.processes)
    for trial, result in sorted(finished, key=lambda pair: trials.index(pair[0])):
        if isinstance(result, Crash):
            crashes.append(f"{trial.recording.name}: {result.error}")
        else:
            compared[trial.seed].append(result)
    return score_row(row.name, FPS / every, list(compared.values()), crashes)


def run(trial: Trial, changes: Sequence[str], bodies: Bodies) -> Compared:
    """One recording, tracked once."""
    if trial.row.changes is None:
        return stand_still(trial.recording, trial.every)
    return track_thinned(trial.recording, trial.every, trial.row.settings(trial.seed, changes), bodies)
