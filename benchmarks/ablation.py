"""The effect of each refine and filter setting of preset default: python -m benchmarks.ablation.

One setting at a time has the value of preset paper. If the presets agree, a count is halved and any other
number is doubled. The recordings are people at 6.3 frames a second: the hard actions, a wave and a jog in
place. Differences from the unchanged preset are paired by recording. Progress on stderr, a Markdown table on
stdout.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from scipy import stats

from benchmarks.people import ONE, STILL, Row, Trial, run_trials
from benchmarks.recordings import choose, find_people
from benchmarks.running import add_data, add_processes, command_line, keep, measured
from benchmarks.tracking import Outcome, near_percent
from gepf.common.errors import InputError
from gepf.coordinator.settings import PRESETS

UNCHANGED = Row("preset default")
RECORDINGS = ("hard", "a3", "a22")
SURE = 0.95  # of an interval


class Difference(msgspec.Struct, frozen=True):
    """Percentage points by which a change is better than the unchanged preset, with the 95 % interval."""

    mean: float
    low: float
    high: float

    @property
    def shows(self) -> bool:
        """Whether the interval excludes zero."""
        return not self.low <= 0.0 <= self.high

    def __str__(self) -> str:
        return f"{self.mean:+.1f} ({self.low:+.1f} to {self.high:+.1f})"


class Effect(msgspec.Struct, frozen=True):
    """The result of one row, for all joints within 10 cm: means over seeds, then over recordings."""

    row: str
    percent: float  # constant offsets removed
    raw_percent: float
    difference: Difference | None  # None for the unchanged preset
    raw_difference: Difference | None


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, write the numbers."""
    parser = command_line("ablation", __doc__)
    add = parser.add_argument
    add_data(parser)
    add("--subjects", nargs="+", type=int, default=[1, 2], metavar="S")
    add("--only", nargs="+", metavar="SETTING", help="only these and the unchanged preset; default: all")
    add("--every", type=int, default=3, metavar="N", help="every n-th frame; default: %(default)s")
    add("--frames", type=int, default=14, metavar="N", help="of each recording; default: the first 14")
    add("--seeds", type=int, default=3, metavar="N", help="default: %(default)s")
    add_processes(parser)
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a recording crashed."""
    rows = choose_rows(chosen.only)
    recordings = choose(find_people(chosen.data, chosen.subjects), RECORDINGS)
    trials = [
        Trial(row, chosen.every, seed, recording)
        for recording in recordings
        for row in rows
        for seed in range(1 if row is STILL else chosen.seeds)
    ]
    outcomes = run_trials(trials, chosen.processes, frames=chosen.frames)
    effects = effects_of(outcomes)
    sys.stdout.write("\n".join(markdown(effects)) + "\n")
    keep(effects, chosen.out)
    return int(len(outcomes) < len(trials))


def choose_rows(only: Sequence[str] | None = None) -> list[Row]:
    """Rows: the unchanged preset, each refine and filter setting (or only these), and the simplest."""
    paper, default = (msgspec.to_builtins(PRESETS[name]) for name in ("paper", "default"))
    changes = {
        key: f"{key}={text(other(value, paper[part][key]))}"
        for part in ("refine", "filter")
        for key, value in default[part].items()
        if not isinstance(value, dict)
    }
    if unknown := [name for name in only or () if name not in changes]:
        raise InputError(f"no setting '{unknown[0]}'; choose from {', '.join(changes)}")
    return [UNCHANGED, *(Row(changes[key], (changes[key],)) for key in only or changes), ONE, STILL]


def other(mine: Any, papers: Any) -> Any:
    """The value of preset paper. If that is the same: half of a count, or twice any other number."""
    if papers != mine:
        return papers
    return mine // 2 if isinstance(mine, int) else 2.0 * mine


def text(value: Any) -> str:
    """The value as written in `key=value`."""
    return value if isinstance(value, str) else json.dumps(value)


def effects_of(outcomes: Mapping[Trial, Outcome]) -> list[Effect]:
    """An effect for each row; the first one is the unchanged preset."""
    shares: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for trial, one in outcomes.items():
        removed, raw = (near_percent(one.distances(raw=raw)) for raw in (False, True))
        shares.setdefault(trial.row.name, {}).setdefault(trial.recording.name, []).append((removed, raw))
    means = {row: {name: np.mean(v, axis=0) for name, v in by.items()} for row, by in shares.items()}
    unchanged = means[UNCHANGED.name]
    effects = []
    for row, mine in means.items():
        paired = np.array([mine[name] - unchanged[name] for name in mine if name in unchanged])
        same = row == UNCHANGED.name or len(paired) < 2
        differences = (None, None) if same else tuple(map(t_interval, paired.T))
        percent, raw = np.mean(list(mine.values()), axis=0)
        effects.append(Effect(row, round(percent, 2), round(raw, 2), *differences))
    return effects


def t_interval(differences: np.ndarray) -> Difference:
    """Mean of paired differences (n,) and its 95 % interval, by Student's t."""
    count, mean = len(differences), float(differences.mean())
    half = float(stats.t.ppf(0.5 + 0.5 * SURE, count - 1) * differences.std(ddof=1) / np.sqrt(count))
    return Difference(round(mean, 2), round(mean - half, 2), round(mean + half, 2))


def markdown(effects: Sequence[Effect]) -> Iterator[str]:
    """Lines of the table."""
    yield "| | within 10 cm | difference (95 %) | raw | difference (95 %) | shows |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for one in effects:
        name = one.row if " " in one.row else f"`{one.row}`"
        pairs = {"offsets removed": one.difference, "raw": one.raw_difference}
        shown = " and ".join(kind for kind, found in pairs.items() if found is not None and found.shows)
        differences = ["" if found is None else str(found) for found in pairs.values()]
        cells = (name, f"{one.percent:.1f} %", differences[0], f"{one.raw_percent:.1f} %", differences[1])
        yield f"| {' | '.join(cells)} | {shown} |"


if __name__ == "__main__":
    sys.exit(main())
