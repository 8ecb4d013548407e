"""Accuracy on people: python -m benchmarks.people.

Real people (UTD-MHAD, compared with the vendor's joints) and skinned people (exact joints), at one or
several frame rates. Each way to track is a row. By default: every frame of all recordings, as with `gepf
track` without options. Progress on stderr, a table on stdout, numbers in a JSON file. Exit code 1 if a
recording crashed.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import msgspec
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from benchmarks.recordings import CUTS_M, Recording, choose, find_people, find_skinned
from benchmarks.running import (
    Crash,
    add_changes,
    add_data,
    add_processes,
    command_line,
    keep,
    measured,
    progress,
    run_forked,
    screen,
    settings_with,
)
from benchmarks.tracking import Outcome, near_percent, prepare, track
from gepf.common.arrays import Array
from gepf.common.errors import InputError
from gepf.coordinator.pictures.plots import styled
from gepf.coordinator.settings import Settings

COLOURS = ("#1b1f27", "#2f9e44", "#3b82c4", "#e8590c")  # from the highest frame rate to the lowest


@dataclass(frozen=True, slots=True)
class Row:
    """A way to track: changes of the settings of `gepf track`, or None for a tracker that never moves."""

    name: str
    changes: tuple[str, ...] | None = ()  # `key=value`
    particles: int | None = None

    def settings(self, seed: int, more: Sequence[str] = ()) -> Settings | None:
        """The settings; `more` changes are applied last."""
        if self.changes is None:
            return None
        return settings_with((*self.changes, *more), self.particles, seed)


DEFAULT = Row("20 particles", (), 20)
STILL = Row("never moves", None)
ONE = Row("1 particle", (), 1)
ROWS = (
    STILL,
    Row("gradient", ("method=gradient",)),
    ONE,
    DEFAULT,
    Row("100 particles", (), 100),
    *(
        Row(
            f"paper's step, {n} iterations", ("explore=false", "pace_iterations=0", f"icp_iterations={n}"), 20
        )
        for n in (3, 6)
    ),
)


@dataclass(frozen=True, slots=True)
class Trial:
    """One recording, tracked once."""

    row: Row
    every: int
    seed: int
    recording: Recording


class Score(msgspec.Struct, frozen=True):
    """Scores of recordings with one row and one frame rate: means over the seeds; all joints weigh the same.

    Percentages are of joints within 10 cm, with offsets removed unless raw, and of joints with a valid
    reference unless all.
    """

    group: str
    row: str
    frames_per_second: float
    percent: float
    cm: float
    raw_percent: float
    raw_cm: float
    all_percent: float
    all_raw_percent: float
    by_seed: list[float]
    worst: str
    worst_percent: float
    status: dict[str, int]
    stature_m: float
    stature_deviation_cm: float  # between recordings
    stature_range_cm: float
    ms_per_frame: float


GROUPS: dict[str, Callable[[Recording], str]] = {
    "data": lambda recording: "real" if recording.action else recording.name,
    "subject": lambda recording: f"subject {recording.subject}" if recording.action else recording.name,
    "action": lambda recording: f"action {recording.action}" if recording.action else recording.name,
    "recording": lambda recording: recording.name,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, write the numbers."""
    parser = command_line("people", __doc__)
    add = parser.add_argument
    add_data(parser)
    add("--only", nargs="+", metavar="NAME", help="recordings (a14_s2, dance), actions (a14), or: hard")
    add("--subjects", nargs="+", type=int, default=[1, 2, 3, 4], metavar="S")
    add("--every", nargs="+", type=int, default=[1], metavar="N", help="every n-th frame")
    add("--rows", nargs="+", default=[DEFAULT.name], metavar="ROW", help=", ".join(r.name for r in ROWS))
    add("--seeds", type=int, default=1, metavar="N")
    add("--cut", choices=CUTS_M, help="end the images here; the seven joints from head to wrists count")
    add("--by", nargs="+", choices=GROUPS, default=["data"], help="lines of the tables; default: data")
    add("--picture", type=Path, metavar="FILE", help="draw accuracy over the number of particles here")
    add_changes(parser)
    add_processes(parser)
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a recording crashed."""
    rows = choose_rows(chosen.rows)
    everybody = [*find_people(chosen.data, chosen.subjects), *find_skinned(chosen.data)]
    recordings = choose(everybody, chosen.only)
    trials = [
        Trial(row, every, seed, recording)
        for every in chosen.every
        for row in rows
        for seed in range(1 if row.name in (STILL.name, "gradient") else chosen.seeds)
        for recording in recordings
    ]
    outcomes = run_trials(trials, chosen.processes, chosen.changes, cut=chosen.cut)
    scores: list[Score] = []
    for by in chosen.by:
        found = list(score_all(outcomes, GROUPS[by]))
        screen().print(table(found))
        scores += found
    keep({"options": {k: str(v) for k, v in vars(chosen).items()}, "scores": scores}, chosen.out)
    if chosen.picture is not None:
        draw(scores, chosen.picture)
    return int(len(outcomes) < len(trials))


def choose_rows(names: Sequence[str]) -> list[Row]:
    """The rows with these names; InputError if one is unknown."""
    known = {row.name: row for row in ROWS}
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"no row '{unknown[0]}'; choose from {', '.join(known)}")
    return [known[name] for name in names]


def run_trials(
    trials: Sequence[Trial],
    processes: int,
    changes: Sequence[str] = (),
    frames: int | None = None,
    cut: str | None = None,
) -> dict[Trial, Outcome]:
    """Results of the trials that did not crash, each in its own process; a line on stderr for each."""
    console, found = progress(), dict[Trial, Outcome]()
    console.print("loading kernels and bodies")
    prepare()

    def run(trial: Trial) -> Outcome:
        return track(trial.recording, trial.row.settings(trial.seed, changes), trial.every, frames, cut)

    for count, (trial, result) in enumerate(run_forked(run, trials, processes), start=1):
        line = f"{count:4} of {len(trials)}  {trial.recording.name:<11} seed {trial.seed}  {trial.row.name}"
        if isinstance(result, Crash):
            console.print(f"{line} crashed: {result.error}")
        else:
            found[trial] = result
            console.print(f"{line}  {near_percent(result.distances(raw=False)[result.holds]):.1f} %")
    return {trial: found[trial] for trial in trials if trial in found}


def score_all(outcomes: Mapping[Trial, Outcome], group: Callable[[Recording], str]) -> Iterator[Score]:
    """A score for each frame rate, row and group of recordings."""
    parts: dict[tuple[int, Row, str], dict[int, list[Outcome]]] = {}
    for trial, outcome in outcomes.items():
        seeds = parts.setdefault((trial.every, trial.row, group(trial.recording)), {})
        seeds.setdefault(trial.seed, []).append(outcome)
    for (_, row, name), by_seed in parts.items():
        yield score(name, row.name, list(by_seed.values()))


def score(group: str, row: str, seeds: Sequence[Sequence[Outcome]]) -> Score:
    """The score of the same recordings over all seeds."""
    kinds = [(raw, held) for held in (True, False) for raw in (False, True)]
    pooled = {kind: [pool(outcomes, *kind) for outcomes in seeds] for kind in kinds}
    near = {kind: [near_percent(one) for one in pooled[kind]] for kind in kinds}
    first = seeds[0]
    each = {one.recording.name: near_percent(pool([one], raw=False, held=True)) for one in first}
    worst = min(each, key=lambda name: each[name])
    statures = np.array([[one.stature for one in outcomes] for outcomes in seeds])
    return Score(
        group=group,
        row=row,
        frames_per_second=round(float(np.median([one.fps for one in first])), 1),
        percent=mean(near[False, True]),
        cm=mean([100.0 * float(np.nanmean(one)) for one in pooled[False, True]]),
        raw_percent=mean(near[True, True]),
        raw_cm=mean([100.0 * float(np.nanmean(one)) for one in pooled[True, True]]),
        all_percent=mean(near[False, False]),
        all_raw_percent=mean(near[True, False]),
        by_seed=[round(one, 2) for one in near[False, True]],
        worst=worst,
        worst_percent=round(each[worst], 2),
        status=dict(sum((Counter(one.status) for one in first), Counter[str]())),
        stature_m=round(float(statures.mean()), 3),
        stature_deviation_cm=mean(100.0 * statures.std(axis=1)),
        stature_range_cm=mean(100.0 * np.ptp(statures, axis=1)),
        ms_per_frame=round(1e3 * float(np.concatenate([one.seconds for one in first]).mean()), 1),
    )


def pool(outcomes: Sequence[Outcome], raw: bool, held: bool) -> Array:
    """Distances of all joints in one array; if `held`, only of joints with a valid reference."""
    return np.concatenate([one.distances(raw=raw)[one.holds if held else ...].ravel() for one in outcomes])


def mean(values: Sequence[float] | Array) -> float:
    """Mean, rounded to two decimals."""
    return round(float(np.mean(values)), 2)


def table(scores: Sequence[Score]) -> Table:
    """The table: a line for each score."""
    shown = Table(
        title="Joints within 10 cm (offsets removed, raw), of which the reference holds, and of all"
    )
    for heading in (
        "frames/s", "row", "of", "%", "cm", "raw %", "raw cm", "all %", "all raw %", "by seed", "worst",
        "frames by status", "stature m, +- cm, range cm", "ms/frame",
    ):  # fmt: skip
        shown.add_column(
            heading, justify="left" if heading in ("row", "of") else "right", no_wrap=heading == "row"
        )
    for one in scores:
        percents = (one.percent, one.cm, one.raw_percent, one.raw_cm, one.all_percent, one.all_raw_percent)
        shown.add_row(
            f"{one.frames_per_second:g}",
            one.row,
            one.group,
            *(f"{value:.2f}" for value in percents),
            " ".join(f"{value:.1f}" for value in one.by_seed),
            f"{one.worst} {one.worst_percent:.1f}",
            " ".join(f"{count} {status}" for status, count in one.status.items() if count),
            f"{one.stature_m:.3f}, {one.stature_deviation_cm:.2f}, {one.stature_range_cm:.1f}",
            f"{one.ms_per_frame:.0f}",
        )
    return shown


def draw(scores: Sequence[Score], file: Path) -> None:
    """Write a PNG: joints within 10 cm over the number of particles, a curve for each frame rate."""
    particles = {row.name: row.particles for row in ROWS if row.particles and not row.changes}
    with styled():
        figure = Figure(figsize=(6.0, 3.4), layout="constrained")
        axes = figure.subplots()
        rates = sorted({score.frames_per_second for score in scores}, reverse=True)
        for rate, colour in zip(rates, cycle(COLOURS)):
            points = sorted(
                (particles[one.row], one.percent)
                for one in scores
                if one.frames_per_second == rate and one.row in particles
            )
            if points:
                axes.semilogx(*zip(*points, strict=True), "o-", color=colour, label=f"{rate:g}")
        axes.set_xticks([1, 20, 100], ["1", "20", "100"], minor=False)
        axes.set_xticks([], minor=True)
        axes.set(xlabel="particles", ylabel="joints within 10 cm, %")
        axes.legend(title="frames a second")
        figure.savefig(file)


if __name__ == "__main__":
    sys.exit(main())
