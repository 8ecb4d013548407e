"""What a report says about a run, in words and numbers: what happened, how far angles went, what to doubt."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coordinator.results.angles import Slides
from coordinator.results.summary import STATUSES
from coordinator.results.track import Track
from coordinator.tracking.certainty.certainty import FLAGGED

Array = NDArray[np.float64]
Summary = dict[str, Any]

FASTEST = np.radians(1200.0)
"""Radians a second: everyday motion stays below. A throw is faster, so a leap may be true."""

LARGE_DEVIATION = np.radians(45.0)
"""From here on an angle is hardly known, so that only a large leap of it is named."""

LARGE_LEAP = np.radians(60.0)
"""From one frame to the next: such a leap is named however uncertain the angle is."""

TRUSTED, DOUBTED = 0.9, 0.5
"""Share of frames that are tracked, from which on a run is trusted, or in parts."""

SIDES = ("right_", "left_")
ARM = ("clavicular", "shoulder", "elbow", "forearm", "wrist", "pinky", "ring", "middle", "index", "thumb")


def describe_run(track: Track, summary: Summary) -> list[tuple[str, str]]:
    """What a reader wants to know first: names and values."""
    model = summary.get("model", {})
    stature = f", {model['stature_m']:.2f} m tall" if model.get("stature_m") else ""
    method, preset, particles = (summary.get(key) for key in ("method", "preset", "particles"))
    workers = len(summary.get("workers_seen", []))
    sent, again = summary.get("batches_sent", 0), summary.get("batches_sent_again", 0)
    return [
        ("frames", f"{len(track.frame)} in {np.ptp(track.time_s):.1f} s"),
        ("status", describe_status(track)),
        ("body", f"{model.get('name', 'unknown')}{stature}, {len(track.dof_names)} degrees of freedom"),
        ("method", f"{method}, preset {preset}, particles: {particles}"),
        ("seed", str(summary.get("seed"))),
        ("speed", f"{summary.get('frame_rate', 0.0):.1f} frames a second"),
        ("service", f"{workers} worker{'s' * (workers != 1)}, {sent} batches, {again} sent again"),
    ]


def describe_status(track: Track) -> str:
    """How many frames have each status that occurs."""
    count = {status: int((track.status == status).sum()) for status in STATUSES}
    return ", ".join(f"{number} {status}" for status, number in count.items() if number)


def describe_stages(summary: Summary) -> list[tuple[str, float, float]]:
    """Stages, the seconds each took, and their share of the longest."""
    stages: dict[str, float] = summary.get("time_per_stage", {})
    longest = max(stages.values(), default=0.0) or 1.0
    return [(stage, seconds, seconds / longest) for stage, seconds in stages.items()]


def group_angles(names: tuple[str, ...]) -> list[tuple[str, tuple[str, ...]]]:
    """Angles by the part of the body, right beside left; of a robot, base and joints."""

    def right_of(name: str) -> str:
        right = name.replace("left_", "right_", 1)
        return right if right in names else name

    groups: dict[str, list[str]] = {"pelvis and trunk": [], "arms": [], "legs": [], "base and joints": []}
    for name in sorted(names, key=lambda name: (names.index(right_of(name)), name.startswith("left_"))):
        if not are_a_persons(names):
            groups["base and joints"].append(name)
        elif name.startswith(SIDES):
            groups["arms" if any(part in name for part in ARM) else "legs"].append(name)
        else:
            groups["pelvis and trunk"].append(name)
    return [(group, tuple(members)) for group, members in groups.items() if members]


def are_a_persons(names: tuple[str, ...]) -> bool:
    """Whether these angles are a person's, not a robot's or an object's."""
    return any(name.startswith(("pelvis_", "trunk_", *SIDES)) for name in names)


@dataclass(frozen=True, slots=True)
class Reach:
    """Least and greatest value, degrees or centimetres, when they were reached, and the greatest speed."""

    least: float
    greatest: float
    least_s: float
    greatest_s: float
    fastest: float
    deviation: float  # the median

    @property
    def motion(self) -> float:
        """The range of motion."""
        return self.greatest - self.least


@dataclass(frozen=True, slots=True)
class Row:
    """A motion, and its reach: of the right side and the left, or of what has no sides."""

    name: str
    right: Reach | None
    left: Reach | None
    middle: Reach | None
    unit: str = "°"
    form: str = "%.0f"


def list_ranges(track: Track) -> list[Row]:
    """A row for each motion, in the order of the plots; none where no frame is known."""
    names, known = track.angle_names, ~track.unknown
    if names is None or track.angle is None or track.angle_deviation is None or not known.any():
        return []
    found = reaches(track, np.degrees(track.angle), np.degrees(track.angle_deviation))
    reach = dict(zip(names, found, strict=True))
    rows: dict[str, dict[str, Reach]] = {}
    for _, members in group_angles(names):
        for name in members:
            side = next((s for s in SIDES if name.startswith(s)), "")
            rows.setdefault(name.removeprefix(side), {})[side] = reach[name]
    return [
        Row(name.replace("_", " "), sides.get("right_"), sides.get("left_"), sides.get(""))
        for name, sides in rows.items()
    ]


def list_slides(track: Track, slides: Slides) -> list[Row]:
    """A row for each sliding joint, in centimetres; none where no frame is known."""
    if track.unknown.all():
        return []
    found = reaches(track, 100.0 * slides.value, 100.0 * slides.deviation)
    return [
        Row(name.replace("_", " "), None, None, reach, unit=" cm", form="%.1f")
        for name, reach in zip(slides.names, found, strict=True)
    ]


def reaches(track: Track, values: Array, deviations: Array) -> list[Reach]:
    """What each of some values (F, N), with their deviations (F, N), did in the known frames."""
    known, found = ~track.unknown, []
    when = track.time_s[known]
    for value, deviation in zip(values[known].T, deviations[known].T, strict=True):
        low, high = int(value.argmin()), int(value.argmax())
        speed = np.abs(np.diff(value)) / np.maximum(np.diff(when), 1e-9)
        ends = (value[low], value[high], when[low], when[high], speed.max(initial=0.0), np.median(deviation))
        found.append(Reach(*map(float, ends)))
    return found


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
    """An angle that changes faster than people move: its frame and time, how much, how uncertain, degrees."""

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
    """All stretches of frames that are not plainly tracked, in order."""
    doubts = []
    for status, members in groupby(range(len(track.frame)), key=lambda f: str(track.status[f])):
        stretch = list(members)
        if status != "tracked":
            ends = [stretch[0], stretch[-1]]
            doubts.append(Doubt(status, *track.frame[ends].tolist(), *track.time_s[ends].tolist()))
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
    """Every step of an angle that is faster than `FASTEST`, where the angle is known or the leap large."""
    if track.angle is None or track.angle_deviation is None or track.angle_names is None:
        return []
    known = ~track.unknown[:, None]
    deviation = np.maximum(track.angle_deviation[1:], track.angle_deviation[:-1])
    change = np.diff(track.angle, axis=0)
    fast = np.abs(change) > FASTEST * np.maximum(np.diff(track.time_s), 1e-9)[:, None]
    named = fast & ((deviation < LARGE_DEVIATION) | (np.abs(change) > LARGE_LEAP)) & known[1:] & known[:-1]
    return [
        Leap(
            track.angle_names[a],
            int(track.frame[f + 1]),
            float(track.time_s[f + 1]),
            float(np.degrees(change[f, a])),
            float(np.degrees(deviation[f, a])),
        )
        for f, a in np.argwhere(named).tolist()
    ]


def find_banner(track: Track, summary: Summary) -> Banner | None:
    """A warning where a run cannot be trusted, whole or in part; None where it can."""
    share = float(np.mean(track.status == "tracked")) if len(track.status) else 0.0
    if share < DOUBTED:
        why = f": {next(iter(summary['doubts']))}" if summary.get("doubts") else ""
        return Banner("lost", f"Do not trust this run: {share:.0%} of its frames are tracked{why}.")
    if share < TRUSTED:
        return Banner("ambiguous", f"Trust this run in parts: {share:.0%} of its frames are tracked.")
    if not summary.get("complete", True):
        return Banner("ambiguous", "This run ended before its last frame.")
    return None
