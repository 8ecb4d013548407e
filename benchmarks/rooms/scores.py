"""How a person fares in a room, beside the same recording cut out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import msgspec
import numpy as np
from rich.table import Table

from benchmarks.rooms.composing import KINDS
from benchmarks.rooms.watching import WatchedIsolation
from benchmarks.scores import within
from benchmarks.tracking import Tracked
from common.settings import Settings
from coordinator.tracking.estimate import UNKNOWN


class RoomScore(msgspec.Struct, frozen=True):
    """One recording in one room; joints are those within 10 cm, constant offsets removed."""

    sequence: str
    kind: str
    seed: int
    frames: int
    alone_percent: float  # cut out
    room_percent: float
    room_raw_percent: float
    lost_from_frame: int | None
    status: dict[str, int]
    precision: float
    recall: float
    ms_per_frame: float  # median
    ms_first_frame: float
    ms_cut: float  # median

    @property
    def key(self) -> tuple[int, int, int, str, int]:
        """By which rooms are in order, and one is told from the others: kind, subject, action, seed."""
        action, _, subject = self.sequence.partition("_s")
        return KINDS.index(self.kind), int(subject), int(action[1:]), self.sequence, self.seed

    @property
    def points(self) -> float:
        """How much better the joints are in the room."""
        return self.room_percent - self.alone_percent

    @property
    def unknown(self) -> int:
        """Frames that are lost, searched or absent."""
        return sum(self.status.get(word, 0) for word in UNKNOWN)

    @property
    def line(self) -> str:
        """All of it, for the terminal."""
        lost = "" if self.lost_from_frame is None else f"  lost from {self.lost_from_frame}"
        return (
            f"{self.sequence:<8} {self.kind:<10} {self.room_percent:5.1f} % ({self.points:+.1f})  "
            f"precision {self.precision:.4f}  recall {self.recall:.4f}  {self.ms_per_frame:5.1f} ms, first "
            f"{self.ms_first_frame:.0f}, cut {self.ms_cut:.1f}  {self.status}{lost}"
        )


class Report(msgspec.Struct, frozen=True):
    """All rooms that were measured last."""

    settings: Settings
    versions: dict[str, str]
    machine: dict[str, str]
    rooms: list[RoomScore]
    crashes: dict[str, str]


def score_room(
    name: str, kind: str, seed: int, tracked: tuple[Tracked, Tracked], isolation: WatchedIsolation
) -> RoomScore:
    """The score of a recording that was tracked cut out, and in a room."""
    alone, inside = tracked
    return RoomScore(
        sequence=name,
        kind=kind,
        seed=seed,
        frames=len(inside.seconds),
        alone_percent=round(within(alone.comparison.offset_removed), 2),
        room_percent=round(within(inside.comparison.offset_removed), 2),
        room_raw_percent=round(within(inside.comparison.raw), 2),
        lost_from_frame=inside.comparison.lost_from,
        status=inside.status,
        precision=round(isolation.mask_precision, 5),
        recall=round(isolation.mask_recall, 5),
        ms_per_frame=round(1e3 * float(np.median(inside.seconds)), 1),
        ms_first_frame=round(1e3 * float(inside.seconds[0]), 1),
        ms_cut=round(1e3 * float(np.median(isolation.seconds)), 2),
    )


def room_table(rooms: Sequence[RoomScore]) -> Table:
    """A line for each kind of room and subject."""
    table = Table(title="Real people in rooms, beside the same recordings cut out")
    for column in (
        "room", "subject", "recordings", "cut out\n<10 cm", "room\n<10 cm", "points", "from", "to", "lost",
        "frames not\ntracked", "precision\nworst", "recall\nworst", "ms/frame",
    ):  # fmt: skip
        table.add_column(column, justify="left" if column == "room" else "right")
    for kind, subject in sorted({one.key[:2] for one in rooms}):
        table.add_row(KINDS[kind], str(subject), *cells([r for r in rooms if r.key[:2] == (kind, subject)]))
    return table


def cells(rooms: Sequence[RoomScore]) -> list[str]:
    """One line's cells after the kind and the subject."""
    points = [one.points for one in rooms]
    status = sum((Counter(one.status) for one in rooms), Counter[str]())
    missed = sum(one.unknown for one in rooms)
    return [
        str(len(rooms)),
        f"{np.mean([one.alone_percent for one in rooms]):.1f}",
        f"{np.mean([one.room_percent for one in rooms]):.1f}",
        f"{np.mean(points):+.1f}",
        f"{min(points):+.1f}",
        f"{max(points):+.1f}",
        str(sum(one.lost_from_frame is not None for one in rooms)),
        f"{missed} of {status.total()}",
        f"{min(one.precision for one in rooms):.4f}",
        f"{min(one.recall for one in rooms):.4f}",
        f"{np.mean([one.ms_per_frame for one in rooms]):.0f}",
    ]
