"""Track people cut out and in rooms, and keep how the two compare."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
from rich.console import Console

from benchmarks.costs.timing import machine
from benchmarks.forks import Crash, run_forked
from benchmarks.people import WIDTH, keep
from benchmarks.rooms.composing import Compose, Job, choose_jobs, load_composer, read_masks
from benchmarks.rooms.scores import Report, RoomScore, room_table, score_room
from benchmarks.rooms.watching import WatchedIsolation
from benchmarks.tracking import Tracked, prepare, track
from common.settings import Settings, preset
from coordinator.bodies.tracked import Bodies
from coordinator.results.configuration import versions


@dataclass(frozen=True, slots=True)
class Choice:
    """What to measure."""

    shared: Path
    only: Sequence[str] | None
    kinds: Sequence[str] | None
    seed: int
    processes: int
    out: Path


@dataclass(frozen=True, slots=True, eq=False)
class Bench:
    """What all jobs need."""

    data: Path
    seed: int
    compose: Compose
    settings: Settings
    bodies: Bodies


def measure(choice: Choice) -> int:
    """Exit code: 1 if a recording crashed."""
    console = Console(stderr=True, soft_wrap=True, highlight=False, markup=False)
    data, tools = choice.shared / "data", choice.shared / "tools"
    jobs = choose_jobs(data, choice.only, choice.kinds)
    bench = Bench(data, choice.seed, load_composer(tools), preset("default"), prepare())
    found, crashes = list[RoomScore](), dict[str, str]()
    for job, result in run_forked(lambda job: play(job, bench), jobs, choice.processes):
        if isinstance(result, Crash):
            crashes[job.recording.name] = result.error
            console.print(f"{job.recording.name}: crashed: {result.error}\n{result.trace}")
        else:
            found += result
            console.print("\n".join(one.line for one in result))
    report = gather(choice, found, crashes)
    Console(width=None if sys.stdout.isatty() else WIDTH).print(room_table(report.rooms))
    keep(report, choice.out)
    return 1 if crashes else 0


def play(job: Job, bench: Bench) -> list[RoomScore]:
    """A recording cut out, and in each of its rooms."""
    alone = track(job.recording, bench.settings, bench.bodies)
    return [play_room(job, kind, alone, bench) for kind in job.kinds]


def play_room(job: Job, kind: str, alone: Tracked, bench: Bench) -> RoomScore:
    """A recording in one room."""
    with tempfile.TemporaryDirectory(prefix="gepf-room-") as folder:
        room = Path(folder) / "room"
        bench.compose(bench.data / "utd_mhad", job.recording.name, bench.seed, room, kind)
        isolation = WatchedIsolation(bench.settings.points, read_masks(room))
        inside = track(replace(job.recording, depth=room), bench.settings, bench.bodies, isolation)
    return score_room(job.recording.name, kind, bench.seed, (alone, inside), isolation)


def gather(choice: Choice, found: Sequence[RoomScore], crashes: dict[str, str]) -> Report:
    """What was measured, with what is kept already of other recordings and rooms."""
    rooms = {one.key: one for one in kept(choice.out)} | {one.key: one for one in found}
    return Report(
        settings=preset("default"),
        versions=versions(),
        machine=machine(),
        rooms=[rooms[key] for key in sorted(rooms)],
        crashes=crashes,
    )


def kept(path: Path) -> list[RoomScore]:
    """The rooms that a file holds; none where there is no file."""
    if not path.is_file():
        return []
    return msgspec.convert(msgspec.json.decode(path.read_bytes())["rooms"], list[RoomScore])
