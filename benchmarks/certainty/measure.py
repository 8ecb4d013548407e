"""Track the chosen recordings, fit if that is wanted, and tell how well the tracker's word holds."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np

from benchmarks.certainty.fitting import fit, halfway
from benchmarks.certainty.gather import Gathered, gather
from benchmarks.certainty.recordings import find_hard, find_rendered, render_demo
from benchmarks.certainty.scores import Score, score, score_table
from benchmarks.certainty.writing import FILE, write_functions
from benchmarks.recordings import Recording
from benchmarks.running import ROOT, Crash, keep, progress, run_forked, screen, settings_with
from benchmarks.tracking import prepare
from common.errors import InputError
from coordinator.bodies.tracked import Bodies
from coordinator.tracking.certainty.assessment import built_in

FIT_SUBJECTS = (1, 2)


def measure(choice: Namespace) -> int:
    """Exit code: 1 if a recording crashed. InputError for what makes no sense."""
    if choice.fit and choice.cut is not None:
        raise InputError("give --fit or --cut: what the tracker goes by is fitted to whole pictures")
    if choice.fit and choice.demo is not None:
        raise InputError("give --fit or --demo: what is fitted is scored on recorded people")
    with TemporaryDirectory() as folder:
        return measure_all(choice, *recordings_of(choice, Path(folder)))


def recordings_of(choice: Namespace, folder: Path) -> tuple[str, list[Recording]]:
    """What is scored: its name and its recordings."""
    if choice.demo is None:
        name = f"subjects {' '.join(map(str, choice.subjects))}"
        return name, find_hard(choice.data, choice.subjects)
    return f"{choice.demo} people of gepf demo", render_demo(folder, choice.demo)


def measure_all(choice: Namespace, name: str, scored: Sequence[Recording]) -> int:
    """Exit code: 1 if a recording crashed."""
    console = progress()
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
    scores.append(score(name, found, functions))
    for line in crashes:
        console.print(line)
    screen().print(score_table(scores))
    options = {name: str(value) for name, value in vars(choice).items()}
    keep({"options": options, "scores": scores}, choice.out)
    return 1 if crashes else 0


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
    recordings: Sequence[Recording], choice: Namespace, bodies: Bodies, crashes: list[str]
) -> list[Gathered]:
    """All recordings, frame rates and seeds, each in a process of its own."""
    settings = settings_with(choice.changes, None)
    jobs = [(r, n, seed) for seed in range(choice.seeds) for n in choice.every for r in recordings]

    def run(job: tuple[Recording, int, int]) -> Gathered:
        recording, n, seed = job
        return gather(recording, n, msgspec.structs.replace(settings, seed=seed), bodies, choice.cut)

    found: dict[int, Gathered] = {}
    for job, result in run_forked(run, jobs, choice.processes):
        if isinstance(result, Crash):
            crashes.append(f"{job[0].name}: {result.error}")
        elif np.size(result.interval):
            found[jobs.index(job)] = result
    return [found[number] for number in sorted(found)]
