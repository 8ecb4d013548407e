"""What a report says about a run, in words and numbers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from coordinator.results.angles import Slides
from coordinator.results.configuration import flatten
from coordinator.results.track import Track
from coordinator.tracking.certainty.certainty import FLAGGED
from coordinator.tracking.estimate import Status

SIDES = ("right_", "left_")
ARM = ("clavicular", "shoulder", "elbow", "forearm", "wrist", "pinky", "ring", "middle", "index", "thumb")


def group_angles(names: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """Angles by the part of the body: pelvis and trunk, arms, legs; of a robot, base and joints."""
    groups: dict[str, list[str]] = {"pelvis and trunk": [], "arms": [], "legs": [], "base and joints": []}
    person = are_a_persons(names)
    for name in sorted(names, key=lambda name: (names.index(pair_of(name, names)), name.startswith("left_"))):
        if not person:
            groups["base and joints"].append(name)
        elif name.startswith(SIDES):
            groups["arms" if any(part in name for part in ARM) else "legs"].append(name)
        else:
            groups["pelvis and trunk"].append(name)
    return [(group, members) for group, members in groups.items() if members]


def are_a_persons(names: tuple[str, ...]) -> bool:
    """Whether these angles are a person's, not a robot's or an object's."""
    return any(name.startswith(("pelvis_", "trunk_", *SIDES)) for name in names)


def pair_of(name: str, names: tuple[str, ...]) -> str:
    """The right one of a pair of sides, the name itself where there is none: pairs stand by this."""
    right = name.replace("left_", "right_", 1)
    return right if right in names else name


Summary = dict[str, Any]


def describe_run(track: Track, summary: Summary) -> list[tuple[str, str]]:
    """What a reader wants to know first: names and values."""
    return [
        ("frames", f"{len(track.frame)} in {np.ptp(track.time_s):.1f} s"),
        ("status", describe_status(track)),
        ("body", describe_body(track, summary.get("model", {}))),
        ("method", describe_method(summary)),
        ("seed", str(summary.get("seed"))),
        ("speed", f"{summary.get('frame_rate', 0.0):.1f} frames a second"),
        ("service", describe_service(summary)),
    ]


def describe_status(track: Track) -> str:
    """How many frames have each status that occurs."""
    count = {status: int((track.status == status).sum()) for status in get_args(Status)}
    return ", ".join(f"{number} {status}" for status, number in count.items() if number)


def describe_body(track: Track, model: Summary) -> str:
    """Its name, stature if it has one, and how much of it moves."""
    stature = f", {model['stature_m']:.2f} m tall" if model.get("stature_m") else ""
    return f"{model.get('name', 'unknown')}{stature}, {len(track.dof_names)} degrees of freedom"


def describe_method(summary: Summary) -> str:
    """Method, preset and number of particles."""
    method, preset, particles = (summary.get(key) for key in ("method", "preset", "particles"))
    return f"{method}, preset {preset}, particles: {particles}"


def describe_service(summary: Summary) -> str:
    """Who worked, and what had to be done again."""
    workers, sent = len(summary.get("workers_seen", [])), summary.get("batches_sent", 0)
    who = f"{workers} worker{'s' * (workers != 1)}"
    return f"{who}, {sent} batches, {summary.get('batches_sent_again', 0)} sent again"


def describe_stages(summary: Summary) -> list[tuple[str, float, float]]:
    """Stages, the seconds each took, and their share of the longest."""
    stages: dict[str, float] = summary.get("time_per_stage", {})
    longest = max(stages.values(), default=0.0) or 1.0
    return [(stage, seconds, seconds / longest) for stage, seconds in stages.items()]


def list_settings(settings: Summary) -> list[tuple[str, str]]:
    """Settings and their values, those of a group after its name and a dot."""
    return [(name, str(value)) for name, value in flatten(settings)]


Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Reach:
    """Least and greatest value, degrees or centimetres, when they were reached, and the greatest speed."""

    least: float
    greatest: float
    least_s: float
    greatest_s: float
    fastest: float
    deviation: float  # of the middle frame when sorted

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
    names = track.angle_names or ()
    known = np.isin(track.status, ("tracked", "ambiguous"))
    if not known.any():
        return []
    rows: dict[str, dict[str, Reach]] = {}
    for _, members in group_angles(names):
        for name in members:
            side = next((s for s in SIDES if name.startswith(s)), "")
            rows.setdefault(name.removeprefix(side), {})[side] = angle_reach(track, names.index(name), known)
    return [
        Row(name.replace("_", " "), sides.get("right_"), sides.get("left_"), sides.get(""))
        for name, sides in rows.items()
    ]


def list_slides(track: Track, slides: Slides) -> list[Row]:
    """A row for each joint that slides, in centimetres."""
    known = np.isin(track.status, ("tracked", "ambiguous"))
    if not known.any():
        return []
    value, deviation = 100.0 * slides.value[known], 100.0 * slides.deviation[known]
    return [
        Row(
            name=name.replace("_", " "),
            right=None,
            left=None,
            middle=reach_of(value[:, s], deviation[:, s], track.time_s[known]),
            unit=" cm",
            form="%.1f",
        )
        for s, name in enumerate(slides.names)
    ]


def angle_reach(track: Track, at: int, known: NDArray[np.bool_]) -> Reach:
    """What one angle did, degrees."""
    if track.angle is None or track.angle_deviation is None:
        raise ValueError("this track has no angles")
    value, deviation = np.degrees(track.angle[known, at]), np.degrees(track.angle_deviation[known, at])
    return reach_of(value, deviation, track.time_s[known])


def reach_of(value: Array, deviation: Array, when: Array) -> Reach:
    """What values (K,) at these seconds did."""
    low, high = int(value.argmin()), int(value.argmax())
    steps = np.abs(np.diff(value)) / np.maximum(np.diff(when), 1e-9) if len(value) > 1 else np.zeros(1)
    return Reach(
        least=float(value[low]),
        greatest=float(value[high]),
        least_s=float(when[low]),
        greatest_s=float(when[high]),
        fastest=float(steps.max()),
        deviation=float(np.median(deviation)),
    )


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
