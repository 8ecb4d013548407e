"""Clothed people and the same motions in swimwear: python -m benchmarks.clothed.

`suit_man` in a suit and `swimwear/suit_man` without differ by clothes, hair and equipment alone. The joints
are exact, and no offsets are removed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.recordings import Recording, read_frames, read_reference
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
    settings_with,
)
from benchmarks.tracking import bodies_of, follow, prepare
from gepf.common.arrays import Array
from gepf.common.errors import InputError
from gepf.coordinator.results.evaluation import THRESHOLDS, positions
from gepf.coordinator.settings import CertaintySettings, Settings
from gepf.coordinator.tracking.tracker import Tracker
from gepf.refiners import DirectRefiner

COLUMNS = ("cm", "<10 cm", "off", "tracked", "wrong", "doubt", "stature", "1 dev", "2 dev")
"""Mean error, share of near joints, of frames with a joint off, of tracked frames, of wrong ones among
these, of frames in doubt without cause, error of the stature, joints within one and two stated deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """The result of a person in F frames."""

    distances: Array  # (F, J) of the joints from the truth, metres
    deviations: Array  # (F, J) as stated, metres; of the whole vector
    status: Sequence[str]
    stature: tuple[float, float]  # estimated and true, metres

    @property
    def wrong(self) -> Array:
        """Which frames have a joint more than 15 cm off (`wrong_m`)."""
        off: Array = self.distances.max(axis=1) > CertaintySettings().wrong_m
        return off


def main(arguments: Sequence[str] | None = None) -> int:
    """Track all people; print a line for each."""
    parser = command_line("clothed", __doc__)
    add_data(parser)
    add_changes(parser)
    add_processes(parser)
    parser.add_argument("--only", nargs="+", metavar="NAME", help="people")
    parser.add_argument("--seeds", type=int, default=1, metavar="N")
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a recording crashed."""
    folders = [f for f in find_clothed(chosen.data) if chosen.only is None or f.name in chosen.only]
    prepare()
    jobs = [
        (folder, settings_with(chosen.changes, seed=seed))
        for folder in folders
        for seed in range(chosen.seeds)
    ]
    outcomes = dict[Path, list[Tracked]]()
    crashed = 0
    for (folder, _), outcome in run_forked(track_person, jobs, chosen.processes):
        if isinstance(outcome, Crash):
            progress().print(outcome.error)
            crashed = 1
        else:
            outcomes.setdefault(folder, []).append(outcome)
    lines = list(table(folders, outcomes))
    print("\n".join(lines))
    keep(lines, chosen.out)
    return crashed


def find_clothed(data: Path) -> list[Path]:
    """The recordings, clothed people first; InputError if there are none."""
    folder = data / "clothed"
    found = sorted(path.parent for path in folder.glob("**/truth.npz"))
    if not found:
        raise InputError(f"{folder} holds no recordings; give the folder with --data")
    return sorted(found, key=lambda path: (path.parent.name == "swimwear", path.name))


def track_person(job: tuple[Path, Settings]) -> Tracked:
    """Track a recording."""
    folder, settings = job
    recording = Recording(folder.name, folder, folder / "truth.npz")
    frames = read_frames(recording)
    reference = read_reference(recording, frames)
    found, _ = follow(Tracker(DirectRefiner(), settings, bodies_of(settings.preset)), frames)
    names = found[-1].state.start.model.joint_names
    shared = tuple(name for name in reference.names if name in names)
    columns, estimates = positions(names, shared), [one.estimate for one in found]
    joints = np.array([one.joint_positions[columns] for one in estimates])
    spread = np.array([one.certainty.deviation[columns] for one in estimates])
    meta = json.loads((folder / "meta.json").read_text(encoding="utf-8"))["person"]
    return Tracked(
        np.linalg.norm(joints - reference.take(shared).joints[: len(joints)], axis=-1),
        spread,
        [one.status for one in estimates],
        (float(found[-1].state.size[0]), float(meta.get("stature_m", np.nan))),
    )


def table(folders: Sequence[Path], outcomes: dict[Path, list[Tracked]]) -> Iterator[str]:
    """A line for each person, and means."""
    yield "".join([f"{'':28}", *(f"{name:>9}" for name in COLUMNS)])
    for folder in folders:
        runs = outcomes.get(folder, [])
        if runs:
            yield f"{folder.parent.name + '/' + folder.name:28}{describe(runs)}"
    for name in ("clothed", "swimwear"):
        runs = [run for folder in folders if folder.parent.name == name for run in outcomes.get(folder, [])]
        if runs:
            yield f"{'all ' + name:28}{describe(runs)}"


def describe(runs: Sequence[Tracked]) -> str:
    """The numbers of COLUMNS; shares in percent, lengths in centimetres."""
    distances = np.concatenate([run.distances for run in runs])
    wrong = np.concatenate([run.wrong for run in runs])
    ratio = distances / np.concatenate([run.deviations for run in runs])
    tracked = np.concatenate([run.status for run in runs]) == "tracked"
    numbers = (
        np.nanmean(distances),
        np.mean(distances < THRESHOLDS.near_m),
        wrong.mean(),
        tracked.mean(),
        wrong[tracked].mean() if tracked.any() else np.nan,
        np.mean(~tracked & ~wrong),
        np.mean([run.stature[0] - run.stature[1] for run in runs]),
        np.mean(ratio < 1.0),
        np.mean(ratio < 2.0),
    )
    return "".join(f"{100.0 * number:9.2f}" for number in numbers)


if __name__ == "__main__":
    sys.exit(main())
