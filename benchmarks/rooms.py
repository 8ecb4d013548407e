"""Accuracy on people in rooms: python -m benchmarks.rooms.

Real people (UTD-MHAD) in rendered rooms, made by the composer in a folder beside the checkout, compared with
the same recordings without a room. Progress on stderr, a table on stdout, numbers in a JSON file.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
from rich.table import Table

from benchmarks.recordings import Recording, choose, find_people
from benchmarks.running import (
    DATA,
    Crash,
    add_processes,
    command_line,
    keep,
    measured,
    progress,
    run_forked,
    screen,
)
from benchmarks.tracking import Outcome, near_percent, prepare, track
from gepf.common.errors import InputError
from gepf.coordinator.files import CAMERA_FILE
from gepf.coordinator.settings import preset
from gepf.coordinator.sources.camera import read_camera, write_camera
from gepf.coordinator.sources.utd_mhad import FPS
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN

SUBJECTS = (1, 3)
EVERYBODY = ("plain", "cluttered")  # rooms of all recordings
SOME = {
    "table": (
        "a2_s1", "a5_s3", "a8_s1", "a11_s3", "a13_s1", "a15_s3", "a18_s1", "a20_s3", "a23_s1", "a26_s3",
    ),
    "visitor": (
        "a1_s3", "a4_s1", "a7_s3", "a9_s1", "a12_s3", "a14_s1", "a17_s3", "a19_s1", "a22_s3", "a27_s1",
    ),
    "wall": ("a3_s1", "a6_s3", "a10_s1", "a16_s3", "a24_s1"),
}  # fmt: skip
"""Rooms that some are put into."""
KINDS = (*EVERYBODY, *SOME)
SEED = 15

Compose = Callable[[Path, str, int, Path, str], None]


@dataclass(frozen=True, slots=True)
class Job:
    """A recording and its rooms."""

    recording: Recording
    kinds: tuple[str, ...]


class RoomScore(msgspec.Struct, frozen=True):
    """One recording in one room: percentage of joints within 10 cm, constant offsets removed."""

    recording: str
    subject: int
    kind: str
    alone_percent: float  # without a room
    room_percent: float
    frames: int
    unknown: int  # frames with status lost, searching or absent

    @property
    def points(self) -> float:
        """Percentage points by which joints are better in the room."""
        return self.room_percent - self.alone_percent


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print the table, write the numbers."""
    parser = command_line("rooms", __doc__)
    add = parser.add_argument
    add("--shared", type=Path, default=DATA.parent, metavar="DIR", help="holds data and tools")
    add("--only", nargs="+", metavar="NAME", help="only these: a14_s2, or a14 (all of this action)")
    add("--kinds", nargs="+", default=list(KINDS), metavar="KIND", help=f"only these: {', '.join(KINDS)}")
    add("--seed", type=int, default=SEED, metavar="N", help="of the rooms")
    add_processes(parser)
    return measured(measure, parser.parse_args(arguments))


def measure(chosen: argparse.Namespace) -> int:
    """Exit code: 1 if a recording crashed."""
    jobs = choose_jobs(chosen.shared / "data", chosen.only, chosen.kinds)
    compose = load_composer(chosen.shared / "tools")
    console, found, crashed = progress(), list[RoomScore](), 0
    prepare()

    def play(job: Job) -> list[RoomScore]:
        alone = track(job.recording, preset("default"))
        return [play_room(kind, alone) for kind in job.kinds]

    def play_room(kind: str, alone: Outcome) -> RoomScore:
        with TemporaryDirectory(prefix="gepf-room-") as folder:
            room = Path(folder) / "room"
            compose(chosen.shared / "data" / "utd_mhad", alone.recording.name, chosen.seed, room, kind)
            camera, scale, _ = read_camera(room)
            write_camera(room / CAMERA_FILE, camera, scale, FPS)  # the composer does not know the rate
            return score(kind, alone, track(replace(alone.recording, depth=room), preset("default")))

    for job, result in run_forked(play, jobs, chosen.processes):
        if isinstance(result, Crash):
            crashed = 1
            console.print(f"{job.recording.name} crashed: {result.error}")
        else:
            found += result
            lines = [
                f"{one.recording:<8} {one.kind:<10} {one.room_percent:5.1f} % ({one.points:+.1f})"
                for one in result
            ]
            console.print("\n".join(lines))
    screen().print(table(found))
    keep(found, chosen.out)
    return crashed


def choose_jobs(data: Path, only: Sequence[str] | None, kinds: Sequence[str]) -> list[Job]:
    """Recordings with their rooms; InputError if one does not exist."""
    if unknown := [kind for kind in kinds if kind not in KINDS]:
        raise InputError(f"no room '{unknown[0]}'; choose from {', '.join(KINDS)}")
    jobs = []
    for recording in choose(find_people(data, SUBJECTS), only):
        rooms = [*EVERYBODY, *(kind for kind, names in SOME.items() if recording.name in names)]
        jobs.append(Job(recording, tuple(kind for kind in rooms if kind in kinds)))
    return [job for job in jobs if job.kinds]


def load_composer(tools: Path) -> Compose:
    """The composer's function; InputError if it does not exist."""
    path = tools / "rooms" / "compose.py"
    spec = importlib.util.spec_from_file_location("compose", path) if path.is_file() else None
    if spec is None or spec.loader is None:
        raise InputError(f"{path} is not there; give the folder of data and tools with --shared")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    compose: Compose = module.compose
    return compose


def score(kind: str, alone: Outcome, inside: Outcome) -> RoomScore:
    """The score of a recording tracked with and without a room; all joints count."""
    before, after = (round(near_percent(one.distances(raw=False)), 2) for one in (alone, inside))
    unknown = sum(inside.status[word] for word in POSE_UNKNOWN)
    recording = alone.recording
    return RoomScore(
        recording.name, recording.subject or 0, kind, before, after, len(inside.seconds), unknown
    )


def table(scores: Sequence[RoomScore]) -> Table:
    """A line for each kind of room and subject."""
    shown = Table(title="Real people in rooms, beside the same recordings without a room")
    for column in (
        "room",
        "subject",
        "recordings",
        "alone %",
        "room %",
        "points",
        "from",
        "to",
        "not tracked",
    ):
        shown.add_column(column, justify="left" if column == "room" else "right")
    for kind, subject in sorted(
        {(one.kind, one.subject) for one in scores}, key=lambda k: (KINDS.index(k[0]), k[1])
    ):
        mine = [one for one in scores if (one.kind, one.subject) == (kind, subject)]
        points = [one.points for one in mine]
        shown.add_row(
            kind,
            str(subject),
            str(len(mine)),
            f"{np.mean([one.alone_percent for one in mine]):.1f}",
            f"{np.mean([one.room_percent for one in mine]):.1f}",
            f"{np.mean(points):+.1f}",
            f"{min(points):+.1f}",
            f"{max(points):+.1f}",
            f"{sum(one.unknown for one in mine)} of {sum(one.frames for one in mine)}",
        )
    return shown


if __name__ == "__main__":
    sys.exit(main())
