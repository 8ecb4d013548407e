"""Where a run should not be trusted: stretches of frames that are not plainly `tracked`."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

from coordinator.results.track import Track


@dataclass(frozen=True, slots=True)
class Doubt:
    """Frames, first to last, that share a status other than `tracked`."""

    status: str
    first: int
    last: int


def find_doubts(track: Track) -> list[Doubt]:
    """All stretches, in order."""
    doubts = []
    for status, stretch in groupby(
        zip(track.status, track.frame, strict=True), key=lambda pair: str(pair[0])
    ):
        frames = [int(frame) for _, frame in stretch]
        if status != "tracked":
            doubts.append(Doubt(status, frames[0], frames[-1]))
    return doubts
