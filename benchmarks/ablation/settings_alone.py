"""Preset default with each of its settings put back to the paper's value, on the arm and on real people."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.table import Table

from benchmarks.choices import settings_with
from benchmarks.costs.timing import machine
from benchmarks.forks import Crash, run_forked
from benchmarks.paper.footage import Footage, shoot
from benchmarks.paper.matrix import HEAVY_ROWS, LETTER, Row
from benchmarks.paper.runs import Job, run
from benchmarks.paper.scores import USUALLY_SETTLED, score_run
from benchmarks.people import WIDTH, keep
from benchmarks.scores import score_recording
from benchmarks.sequences import Recording, choose, find_recordings
from benchmarks.tracking import prepare, track
from common.errors import InputError
from common.settings import PRESETS, Settings
from coordinator.bodies.tracked import Bodies
from coordinator.results.configuration.versions import versions

WHOLE = "all of preset default"


@dataclass(frozen=True, slots=True)
class Choice:
    """What to measure."""

    data: Path
    only: Sequence[str] | None
    people: Sequence[str]
    frames: int
    seeds: int
    processes: int
    out: Path


@dataclass(frozen=True, slots=True)
class Trial:
    """A setting put back (None for none of them), and where: a seed of the arm, or a person."""

    change: str | None
    seed: int | None = None
    person: Recording | None = None


class Effect(msgspec.Struct, frozen=True):
    """What came of preset default with one setting put back."""

    change: str  # `key=value`
    arm_reported_deg: list[float]  # by seed, from frame 30 on
    arm_best_deg: list[float]
    arm_lost: int
    person_within_10cm_percent: dict[str, float]  # offset removed
    ms_per_frame: float | None  # of the arm


class Ablation(msgspec.Struct, frozen=True):
    """All effects, the unchanged preset first."""

    settings: Settings
    versions: dict[str, str]
    machine: dict[str, str]
    frames: int
    effects: list[Effect]
    crashes: dict[str, str]


def measure(choice: Choice) -> int:
    """Exit code: 1 if a run crashed."""
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    changes = choose_changes(choice.only)
    people = choose(find_recordings(choice.data), choice.people) if choice.people else []
    console.print("rendering, loading kernels and bodies")
    footage, bodies = shoot("arm"), prepare()
    row = replace(HEAVY_ROWS[-1], frames=choice.frames)
    trials = [
        trial
        for change in (None, *changes)
        for trial in (
            *(Trial(change, seed=seed) for seed in range(choice.seeds)),
            *(Trial(change, person=person) for person in people),
        )
    ]
    found: dict[Trial, Any] = {}
    finished = run_forked(lambda trial: try_out(trial, row, footage, bodies), trials, choice.processes)
    for trial, result in finished:
        found[trial] = result
        console.print(f"{len(found):3} of {len(trials)}  {name_of(trial)}  {describe(result)}")
    ablation = Ablation(
        settings=PRESETS["default"],
        versions=versions(),
        machine=machine(),
        frames=choice.frames,
        effects=[gather(change, found) for change in (None, *changes)],
        crashes={name_of(t): r.error for t, r in found.items() if isinstance(r, Crash)},
    )
    Console(width=None if sys.stdout.isatty() else WIDTH).print(effect_table(ablation))
    keep(ablation, choice.out)
    return 1 if ablation.crashes else 0


def choose_changes(only: Sequence[str] | None) -> list[str]:
    """`key=value` of all that preset default does otherwise than the paper, with the paper's value."""
    paper, default = (msgspec.to_builtins(PRESETS[name]) for name in ("paper", "default"))
    changes = {
        key: f"{key}={json.dumps(value)}"
        for mine, other in (
            (paper, default),
            (paper["refine"], default["refine"]),
            (paper["filter"], default["filter"]),
        )
        for key, value in mine.items()
        if other[key] != value and not isinstance(value, dict) and key != "preset"
    }
    changes |= {change.partition("=")[0]: change for change in LETTER}
    for key in only or ():
        if key not in changes:
            raise InputError(f"'{key}' is the same in the paper; choose from {', '.join(changes)}")
    return [change for key, change in changes.items() if only is None or key in only]


def try_out(trial: Trial, row: Row, footage: Footage, bodies: Bodies) -> dict[str, float | bool]:
    """Errors of one trial."""
    changes = () if trial.change is None else (trial.change,)
    if trial.person is not None:
        scored = score_recording(trial.person.name, track(trial.person, settings_with(changes), bodies))
        offset_removed = scored.joints.offset_removed or scored.joints.raw
        return {"percent": offset_removed.within_10cm_percent if offset_removed else 0.0}
    done = run(Job(replace(row, changes=changes), trial.seed or 0), footage)
    one = score_run(done, USUALLY_SETTLED, None)
    return {
        "reported": one.reported_deg,
        "best": one.best_deg,
        "lost": one.lost_from_frame is not None,
        "ms": one.ms_per_frame,
    }


def gather(change: str | None, found: dict[Trial, Any]) -> Effect:
    """All that is known of one change."""
    of = {t: r for t, r in found.items() if t.change == change and not isinstance(r, Crash)}
    arm = [r for t, r in sorted(of.items(), key=lambda item: item[0].seed or 0) if t.person is None]
    return Effect(
        change=change or WHOLE,
        arm_reported_deg=[r["reported"] for r in arm],
        arm_best_deg=[r["best"] for r in arm],
        arm_lost=sum(r["lost"] for r in arm),
        person_within_10cm_percent={
            t.person.name: r["percent"] for t, r in of.items() if t.person is not None
        },
        ms_per_frame=round(sum(r["ms"] for r in arm) / len(arm), 1) if arm else None,
    )


def name_of(trial: Trial) -> str:
    """What is tried where."""
    where = f"arm seed {trial.seed}" if trial.person is None else trial.person.name
    return f"{trial.change or WHOLE:<32} {where}"


def describe(result: Any) -> str:
    """How one trial went."""
    if isinstance(result, Crash):
        return f"crashed: {result.error}"
    return "  ".join(f"{key} {value}" for key, value in result.items())


def effect_table(result: Ablation) -> Table:
    """A line for each setting."""
    people = list(result.effects[0].person_within_10cm_percent)
    table = Table(title="Preset default with one setting at a time as in preset paper")
    for column in (
        "setting",
        "arm reported deg",
        "arm best deg",
        "lost",
        *(f"{p} <10 cm" for p in people),
        "ms/frame",
    ):
        table.add_column(column, justify="left" if column == "setting" else "right")
    for one in result.effects:
        table.add_row(
            one.change,
            mean(one.arm_reported_deg),
            mean(one.arm_best_deg),
            str(one.arm_lost),
            *(f"{one.person_within_10cm_percent.get(p, float('nan')):.1f} %" for p in people),
            "-" if one.ms_per_frame is None else f"{one.ms_per_frame:.0f}",
        )
    return table


def mean(values: Sequence[float]) -> str:
    """With two decimals."""
    return f"{sum(values) / len(values):.2f}" if values else "-"
