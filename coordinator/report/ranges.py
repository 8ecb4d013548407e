"""How far each angle, and what slides, went and how fast, over the frames in which it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coordinator.report.groups import SIDES, group_angles
from coordinator.results.slides import Slides
from coordinator.results.track import Track

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
