"""Track the chosen recordings, fit if that is wanted, and tell how well the tracker's word holds."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console

from benchmarks.certainty.fitting import Functions, fit, halfway
from benchmarks.certainty.gather import Gathered, gather
from benchmarks.certainty.scores import Score, score, score_table
from benchmarks.certainty.writing import FILE, write_functions
from benchmarks.choices import settings_with
from benchmarks.command_line import ROOT
from benchmarks.costs.timing import machine
from benchmarks.forks import Crash, run_forked
from benchmarks.frame_rates.rows import HARD_ACTIONS
from benchmarks.people import WIDTH, keep
from benchmarks.sequences import Recording, find_people
from benchmarks.tracking import prepare
from common.errors import InputError
from coordinator.bodies.tracked import Bodies
from coordinator.results.configuration.versions import versions
from coordinator.tracking.certainty.assessment import table
from coordinator.tracking.certainty.fitted import DEVIATION, PROBABILITY, UNSEEN

FIT_SUBJECTS = (1, 2)
RENDERED = ("skinned", "three_cameras", "rooms")


@dataclass(frozen=True, slots=True)
class Choice:
    """What to measure."""

    data: Path
    fit: bool
    subjects: Sequence[int]
    every: Sequence[int]
    cut: float | None
    changes: Sequence[str]
    seeds: int
    processes: int
    out: Path | None


class Report(msgspec.Struct, frozen=True):
    """One run of the benchmark."""

    every: list[int]
    cut: float | None
    changes: list[str]
    seeds: int
    versions: dict[str, str]
    machine: dict[str, str]
    scores: list[Score]


def measure(choice: Choice) -> int:
    """Exit code: 1 if a recording crashed. InputError for what makes no sense."""
    if choice.fit and choice.cut is not None:
        raise InputError("give --fit or --cut: what the tracker goes by is fitted to whole pictures")
    scored = find_hard(choice.data, choice.subjects)
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    console.print("loading kernels and bodies")
    bodies, crashes, scores, functions = prepare(), list[str](), list[Score](), built_in()
    if choice.fit:
        real = track_all(find_hard(choice.data, FIT_SUBJECTS), choice, bodies, crashes)
        rendered = track_all(find_rendered(choice.data), choice, bodies, crashes)
        functions = halfway(functions, fit([*real, *rendered]))
        write_functions(functions, ROOT / FILE)
        scores.append(score("fitted: subjects 1 2", real, functions))
        scores += [
            score(f"rendered, held apart: {name}", part, fit([*real, *rest]))
            for name, part, rest in apart(rendered)
        ]
    found = track_all(scored, choice, bodies, crashes)
    scores.append(score(f"subjects {' '.join(map(str, choice.subjects))}", found, functions))
    for line in crashes:
        console.print(line)
    Console(width=None if sys.stdout.isatty() else WIDTH).print(score_table(scores))
    if choice.out is not None:
        changes, every = list(choice.changes), list(choice.every)
        keep(Report(every, choice.cut, changes, choice.seeds, versions(), machine(), scores), choice.out)
    return 1 if crashes else 0


def built_in() -> Functions:
    """What the tracker goes by."""
    low, high, probability, deviation = table()
    return Functions(low, high, (PROBABILITY, probability), (DEVIATION, deviation), UNSEEN)


def find_hard(data: Path, subjects: Sequence[int]) -> list[Recording]:
    """The hard actions of subjects; InputError where there are none."""
    wanted = {f"s{subject}" for subject in subjects}
    found = [
        recording
        for recording in find_people(data / "utd_mhad")
        if recording.action in HARD_ACTIONS and recording.name.rpartition("_")[2] in wanted
    ]
    if not found:
        raise InputError(f"{data} holds no such recordings of UTD-MHAD; give the folder with --data")
    return found


def find_rendered(data: Path) -> list[Recording]:
    """Rendered people whose joints are known exactly."""
    folders = [folder for group in RENDERED for folder in sorted((data / group).glob("*"))]
    there = [folder for folder in folders if (folder / "truth.npz").exists()]
    return [Recording(folder.name, folder, folder / "truth.npz") for folder in there]


def apart(gathered: Sequence[Gathered]) -> list[tuple[str, list[Gathered], list[Gathered]]]:
    """Each performance with all the others."""
    names = sorted({one.performance for one in gathered})
    return [
        (
            name,
            [one for one in gathered if one.performance == name],
            [one for one in gathered if one.performance != name],
        )
        for name in names
    ]


def track_all(
    recordings: Sequence[Recording], choice: Choice, bodies: Bodies, crashes: list[str]
) -> list[Gathered]:
    """All recordings, frame rates and seeds, each in a process of its own."""
    settings = settings_with(choice.changes, None)
    jobs = [(r, every, seed) for seed in range(choice.seeds) for every in choice.every for r in recordings]

    def run(job: tuple[Recording, int, int]) -> Gathered:
        recording, every, seed = job
        return gather(recording, every, msgspec.structs.replace(settings, seed=seed), bodies, choice.cut)

    found: dict[int, Gathered] = {}
    for job, result in run_forked(run, jobs, choice.processes):
        if isinstance(result, Crash):
            crashes.append(f"{job[0].name}: {result.error}")
        elif np.size(result.interval):
            found[jobs.index(job)] = result
    return [found[number] for number in sorted(found)]
