"""Where a run should not be trusted: frames that are not plainly `tracked`, and leaps of an angle."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from coordinator.results.track import Track
from coordinator.tracking.certainty.certainty import FLAGGED

FASTEST = np.radians(1200.0)
"""Radians a second: everyday motion stays below. Who throws a ball is faster, so a leap may be true."""

UNKNOWN = np.radians(45.0)
"""Deviation from which on nobody claims to know an angle, so that only a wide leap of it is named."""

WIDE = np.radians(60.0)
"""From one frame to the next: such a leap is named however unsure the angle is said to be."""

TRUSTED, DOUBTED = 0.9, 0.5
"""Share of frames that are tracked, from which on a run is trusted, or in parts."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Frames, first to last, that share a status other than `tracked`."""

    status: str
    first: int
    last: int
    first_s: float
    last_s: float


@dataclass(frozen=True, slots=True)
class Flag:
    """A joint that may well be more than 15 cm off: in what share of the frames, and in which most likely."""

    joint: str
    share: float
    worst: int
    chance: float  # there


@dataclass(frozen=True, slots=True)
class Leap:
    """An angle that changes faster than people move: its frame and time, how much, how sure, degrees."""

    angle: str
    frame: int
    time_s: float
    change_deg: float
    deviation_deg: float  # the larger of both frames


@dataclass(frozen=True, slots=True)
class Banner:
    """What a reader has to know before anything else."""

    kind: str  # the status that colours it
    text: str


def find_doubts(track: Track) -> list[Doubt]:
    """All stretches, in order."""
    doubts = []
    for status, stretch in groupby(
        zip(track.status, track.frame, track.time_s, strict=True), key=lambda each: str(each[0])
    ):
        frames = [(int(frame), float(time_s)) for _, frame, time_s in stretch]
        if status != "tracked":
            (first, first_s), (last, last_s) = frames[0], frames[-1]
            doubts.append(Doubt(status, first, last, first_s, last_s))
    return doubts


def find_flags(track: Track) -> list[Flag]:
    """Joints that are flagged in some frame, the most often flagged first."""
    if track.joint_off_probability is None:
        return []
    chance = np.nan_to_num(track.joint_off_probability)
    shares = (chance > FLAGGED).sum(axis=0) / max(1, len(chance))
    return [
        Flag(
            track.joint_names[j].replace("_", " "),
            float(shares[j]),
            int(track.frame[np.argmax(chance[:, j])]),
            float(chance[:, j].max()),
        )
        for j in np.argsort(-shares, kind="stable")
        if shares[j] > 0.0
    ]


def find_leaps(track: Track) -> list[Leap]:
    """Every step of an angle that is faster than `FASTEST`, where the angle is known, or is `WIDE`."""
    if track.angle is None or track.angle_deviation is None or len(track.frame) < 2:
        return []
    there = np.isin(track.status, ("tracked", "ambiguous"))[:, None]
    unsure = np.maximum(track.angle_deviation[1:], track.angle_deviation[:-1])
    change = np.diff(track.angle, axis=0)
    fast = np.abs(change) > FASTEST * np.maximum(np.diff(track.time_s), 1e-9)[:, None]
    named = fast & ((unsure < UNKNOWN) | (np.abs(change) > WIDE)) & there[1:] & there[:-1]
    names = track.angle_names or ()
    return [
        Leap(
            names[a],
            int(track.frame[f + 1]),
            float(track.time_s[f + 1]),
            float(np.degrees(change[f, a])),
            float(np.degrees(unsure[f, a])),
        )
        for f, a in np.argwhere(named).tolist()
    ]


def describe_why(summary: dict[str, object]) -> str:
    """What speaks against most frames that are not tracked, after a colon; empty where nothing does."""
    doubts = summary.get("doubts")
    return f": {next(iter(doubts))}" if isinstance(doubts, dict) and doubts else ""


def find_banner(track: Track, summary: dict[str, object]) -> Banner | None:
    """A warning where a run cannot be trusted, whole or in part; None where it can."""
    share = float(np.mean(track.status == "tracked")) if len(track.status) else 0.0
    if share < DOUBTED:
        return Banner(
            "lost", f"Do not trust this run: {share:.0%} of its frames are tracked{describe_why(summary)}."
        )
    if share < TRUSTED:
        return Banner("ambiguous", f"Trust this run in parts: {share:.0%} of its frames are tracked.")
    if not summary.get("complete", True):
        return Banner("ambiguous", "This run ended before its last frame.")
    return None
