"""Track all recordings that are chosen, and tell how well that went."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from rich.console import Console

from benchmarks.choices import settings_with
from benchmarks.forks import Crash, run_forked
from benchmarks.real_people.report import Results, report
from benchmarks.real_people.tables import accuracy_cells, show
from benchmarks.scores import score_recording
from benchmarks.sequences import Recording, choose, find_recordings
from benchmarks.tracking import Tracked, prepare, track
from common.settings import Settings
from coordinator.files import write_atomically

WIDTH = 150  # columns of a table that goes to no terminal


@dataclass(frozen=True, slots=True)
class Choice:
    """What to measure."""

    data: Path
    only: Sequence[str] | None
    particles: int | None
    processes: int
    changes: Sequence[str]
    out: Path | None


def measure(choice: Choice) -> int:
    """Exit code: 1 if a sequence crashed. InputError for what makes no sense, before anything is tracked."""
    settings = settings_with(choice.changes, choice.particles)
    recordings = choose(find_recordings(choice.data), choice.only)
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    results = track_all(recordings, settings, choice.processes, console)
    result = report(recordings, results, settings, choice.processes)
    show(result, Console(width=None if sys.stdout.isatty() else WIDTH))
    if choice.out is None:
        console.print("the numbers of a part or of other settings are kept only with --out FILE")
    else:
        keep(result, choice.out)
    return 1 if result.crashes else 0


def track_all(
    recordings: Sequence[Recording], settings: Settings, processes: int, console: Console
) -> Results:
    """Each recording in a process of its own; results in the order of the recordings."""
    console.print("loading kernels and bodies")
    bodies = prepare()
    found: dict[str, Tracked | Crash] = {}
    for recording, result in run_forked(lambda r: track(r, settings, bodies), recordings, processes):
        found[recording.name] = result
        console.print(f"{len(found):3} of {len(recordings)}  {recording.name:<11} {describe(result)}")
    return {recording.name: found[recording.name] for recording in recordings}


def describe(result: Tracked | Crash) -> str:
    """How one recording went: a line, or after a crash the trace."""
    if isinstance(result, Crash):
        return f"crashed: {result.error}\n{result.trace}".rstrip()
    scored = score_recording("", result)
    kinds = (scored.joints.raw, scored.joints.offset_removed)
    raw, offset_removed = ("{:>5} % {:>5} cm".format(*accuracy_cells(kind)) for kind in kinds)
    lost = "" if scored.lost_from_frame is None else f"  lost from {scored.lost_from_frame}"
    return f"raw {raw}  offset removed {offset_removed}  {scored.ms_per_frame:6.1f} ms{lost}"


def keep(result: msgspec.Struct, path: Path) -> None:
    """Write the numbers."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = msgspec.json.format(msgspec.json.encode(result), indent=2)
    write_atomically(path, lambda file: file.write(text + b"\n"))
