"""Signed distance to a person with given measures, in the building pose: a smooth union of tapered parts.

In the building pose the arms are raised to `ARMS_RAISED` from the vertical and the legs are spread by
`LEGS_SPREAD`, so that armpits and crotch are open. It is in the middle of common poses.

The outline of a clothed adult is given by tables of elliptic sections. Rows: position along the part, then
the section's centre and half-widths in the two other coordinates (in the order x, y, z), in percent of
stature.
At chest, waist and hips, breadths and depths are the means of both sexes (as fractions of stature) in Gordon
et al., "2012 Anthropometric Survey of U.S. Army Personnel" (NATICK/TR-15/007), plus 1-2 cm of clothes; the
other sections were estimated. Caps are the lengths of the rounded ends before the first and after the
last row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from coordinator.bodies.human.measures import FRACTIONS_OF_STATURE, Measures
from coordinator.bodies.human.skeleton import Skeleton

Row = tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Part:
    """A part of the outline; `clothed` parts widen with girth."""

    axis: int
    rows: tuple[Row, ...]
    caps: tuple[float, float]
    clothed: bool = True


# Down from the shoulder joints, in units of the trunk (0 shoulders, 1 hips).
TRUNK = Part(
    axis=1,
    rows=(
        (-0.13, 0.0, 1.5, 4.2, 3.9),
        (-0.07, 0.0, 1.5, 6.2, 4.8),
        (0.02, 0.0, 1.2, 8.5, 5.7),
        (0.13, 0.0, 0.7, 8.9, 6.9),
        (0.27, 0.0, 0.3, 8.9, 7.4),
        (0.45, 0.0, 0.1, 9.1, 7.0),
        (0.61, 0.0, -0.2, 9.3, 6.8),
        (0.78, 0.0, -0.1, 9.6, 6.9),
        (0.92, 0.0, 0.4, 9.8, 6.8),
        (1.04, 0.0, 0.7, 9.6, 6.4),
        (1.12, 0.0, 0.9, 8.8, 5.6),
    ),
    caps=(2.0, 5.0),
)
NECK = Part(
    axis=1,
    rows=(
        (-0.42, 0.0, -0.3, 3.1, 3.4),
        (-0.30, 0.0, 0.2, 3.15, 3.4),
        (-0.17, 0.0, 1.0, 3.4, 3.6),
        (-0.06, 0.0, 1.5, 3.9, 3.9),
    ),
    caps=(2.0, 3.0),
    clothed=False,
)
BUTTOCK = Part(
    axis=1,
    rows=((0.90, 4.2, 2.8, 4.2, 3.6), (1.04, 4.3, 3.7, 4.5, 4.2), (1.16, 4.4, 3.1, 4.0, 3.6)),
    caps=(6.0, 3.5),
)
# Sideways from the middle, in units of half the shoulder width; y and z from the shoulder joint.
SHOULDER = Part(
    axis=0,
    rows=((0.15, -3.4, 0.4, 2.8, 3.4), (0.50, -1.9, 0.2, 2.5, 3.5), (0.90, -0.2, 0.0, 2.5, 3.4)),
    caps=(2.0, 2.0),
)
# Down from the base of the skull, in percent of stature.
SKULL = Part(
    axis=1,
    rows=((-3.4, 0.0, 0.1, 4.5, 5.8), (-1.5, 0.0, 0.0, 4.4, 5.6), (0.2, 0.0, -0.3, 3.9, 4.9)),
    caps=(5.0, 3.0),
    clothed=False,
)
JAW = Part(
    axis=1,
    rows=(
        (-2.5, 0.0, -1.8, 4.1, 4.0),
        (-0.5, 0.0, -2.3, 3.85, 3.6),
        (1.6, 0.0, -2.8, 3.2, 2.9),
        (3.4, 0.0, -3.5, 2.2, 1.9),
    ),
    caps=(2.5, 1.3),
    clothed=False,
)
# Down the upright arm (0 shoulder, 1 elbow, 2 wrist), from the shoulder joint.
ARM = Part(
    axis=1,
    rows=(
        (0.05, 0.2, 0.0, 3.0, 3.4),
        (0.30, 0.3, -0.1, 2.8, 3.2),
        (0.62, 0.2, -0.1, 2.6, 2.9),
        (1.00, 0.0, 0.1, 2.3, 2.5),
        (1.25, 0.0, 0.0, 2.4, 2.7),
        (1.60, 0.0, 0.0, 2.0, 2.25),
        (1.92, 0.0, 0.0, 1.6, 1.9),
    ),
    caps=(3.4, 1.5),
)
# Down the hand, in units of its length, from the wrist.
HAND = Part(
    axis=1,
    rows=(
        (0.05, 0.0, 0.0, 1.3, 1.7),
        (0.28, -0.1, 0.0, 1.35, 2.2),
        (0.48, -0.3, 0.0, 1.4, 2.35),
        (0.70, -0.6, 0.1, 1.35, 2.1),
    ),
    caps=(1.0, 3.0),
    clothed=False,
)
THUMB = Part(
    axis=1,
    rows=((0.16, -0.2, -1.3, 1.0, 1.0), (0.35, -0.4, -2.3, 0.9, 0.95), (0.52, -0.5, -2.9, 0.85, 0.85)),
    caps=(1.0, 1.2),
    clothed=False,
)
# Down the leg (0 hip, 1 knee, 2 ankle); x from the hip joint.
LEG = Part(
    axis=1,
    rows=(
        (0.05, -0.1, 0.6, 5.05, 5.5),
        (0.22, -0.1, 0.5, 5.05, 5.5),
        (0.45, 0.0, 0.3, 4.5, 4.9),
        (0.75, 0.0, 0.2, 3.8, 4.1),
        (0.97, 0.0, 0.1, 3.35, 3.65),
        (1.08, 0.0, 0.5, 3.2, 3.55),
        (1.32, 0.1, 1.1, 3.45, 3.8),
        (1.58, 0.0, 1.3, 2.9, 3.2),
        (1.84, 0.0, 1.4, 2.3, 2.6),
        (1.98, 0.0, 1.4, 2.25, 2.6),
    ),
    caps=(4.0, 2.0),
)
# Backward from the ankle, in units of the foot; y from the sole.
FOOT = Part(
    axis=2,
    rows=(
        (-0.52, 0.0, -1.6, 2.9, 1.6),
        (-0.36, 0.0, -1.8, 2.85, 1.8),
        (-0.15, 0.0, -2.1, 2.3, 2.1),
        (0.05, 0.0, -2.2, 2.1, 2.2),
        (0.14, 0.0, -2.1, 2.0, 2.1),
    ),
    caps=(5.2, 2.8),
    clothed=False,
)


Array = NDArray[np.float64]

SAMPLES = 96
REACH, FAR = 0.12, 1.0
"""At more than REACH metres from the box of a loft, its distance is not computed but set to FAR."""


@dataclass(frozen=True)
class Loft:
    """Sections across one coordinate axis, with rounded ends.

    Rows of `sections` (S, 5): position along `axis` in ascending order, then centre and half-widths in the
    two other coordinates. `caps` are the lengths of the half-ellipsoids beyond the first and last section.
    """

    axis: int
    sections: Array  # (S, 5)
    caps: tuple[float, float]

    def distance(self, points: Array) -> Array:
        """Approximate signed distance (n,) of points (n, 3): correct sign, first order near the surface."""
        low, high = self._box
        near = np.all((points > low) & (points < high), axis=1)
        distance = np.full(len(points), FAR)
        distance[near] = self._near_distance(points[near])
        return distance

    def _near_distance(self, points: Array) -> Array:
        """From the implicit function f = 1 - |scaled point|, as f / |gradient of f|."""
        table = self._table
        along = np.clip(points[:, self.axis], table[0, 0], table[-1, 0])
        step = (along - table[0, 0]) / (table[1, 0] - table[0, 0])
        row = np.minimum(step.astype(np.int64), SAMPLES - 2)
        share = (step - row)[:, None]
        centre_width = table[row, 1:] * (1.0 - share) + table[row + 1, 1:] * share
        beyond = points[:, self.axis] - along
        a, b, c = centre_width[:, 2], centre_width[:, 3], np.where(beyond < 0.0, *self.caps)
        first, second = (k for k in range(3) if k != self.axis)
        u = (points[:, first] - centre_width[:, 0]) / a
        v = (points[:, second] - centre_width[:, 1]) / b
        w = beyond / c
        norm = np.sqrt(u * u + v * v + w * w)
        slope = np.sqrt((u / a) ** 2 + (v / b) ** 2 + (w / c) ** 2) / np.maximum(norm, 1e-9)
        return np.asarray((norm - 1.0) / np.maximum(slope, 1.0 / np.maximum(a, b)))

    @cached_property
    def _table(self) -> Array:
        """Sections (SAMPLES, 5) at equal distances on a monotone cubic through the given ones."""
        position = np.linspace(self.sections[0, 0], self.sections[-1, 0], SAMPLES)
        between = PchipInterpolator(self.sections[:, 0], self.sections[:, 1:])
        return np.column_stack([position, between(position)])

    @cached_property
    def _box(self) -> tuple[Array, Array]:
        low, high = np.empty(3), np.empty(3)
        others = [k for k in range(3) if k != self.axis]
        low[self.axis] = self.sections[0, 0] - self.caps[0]
        high[self.axis] = self.sections[-1, 0] + self.caps[1]
        low[others] = np.min(self.sections[:, 1:3] - self.sections[:, 3:], axis=0)
        high[others] = np.max(self.sections[:, 1:3] + self.sections[:, 3:], axis=0)
        return low - REACH, high + REACH


def smooth_union(distances: Iterable[Array], width: float) -> Array:
    """Smooth minimum of distances; the exact minimum if two differ by more than `width`."""

    def of_two(first: Array, second: Array) -> Array:
        overlap = np.maximum(width - np.abs(first - second), 0.0) / width
        return np.minimum(first, second) - overlap**3 * width / 6.0

    return reduce(of_two, distances)


ARMS_RAISED, LEGS_SPREAD = np.radians(55.0), np.radians(6.0)
MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Shape:
    """Parts in the middle of the body, and those of the left side; the right side mirrors them."""

    middle: tuple[Loft, ...]
    girdle: tuple[Loft, ...]
    arm: tuple[Loft, ...]
    leg: tuple[Loft, ...]
    t_arm: Array  # (3, 4) building pose -> upright arm with the shoulder joint at the origin
    t_leg: Array  # (3, 4) building pose -> rest
    percent: float  # of stature, in metres

    def distance(self, points: Array) -> Array:
        """Signed distance (n,) to the surface, for points (n, 3) in the building pose."""
        middle = smooth_union((loft.distance(points) for loft in self.middle), 1.6 * self.percent)
        girdle = self._both_sides(lambda left: self._union(self.girdle, left, 2.0), points)
        legs = self._both_sides(lambda left: self._union(self.leg, moved(self.t_leg, left), 1.6), points)
        arms = self._both_sides(lambda left: self._union(self.arm, moved(self.t_arm, left), 0.8), points)
        trunk = smooth_union((middle, girdle), 3.0 * self.percent)
        body = smooth_union((trunk, legs), 2.5 * self.percent)
        return smooth_union((body, arms), 3.5 * self.percent)

    def _both_sides(self, left: Callable[[Array], Array], points: Array) -> Array:
        return smooth_union((left(points), left(points * MIRROR)), 0.7 * self.percent)

    def _union(self, lofts: tuple[Loft, ...], points: Array, width: float) -> Array:
        return smooth_union((loft.distance(points) for loft in lofts), width * self.percent)


def shape_person(measures: Measures, skeleton: Skeleton) -> Shape:
    """The outline on the joints of a person with these measures."""
    at = skeleton.joints
    shoulder, hip, ankle = at["l_shoulder"], at["l_hip"], at["l_ankle"]
    trunk_knots = np.array([-measures.trunk, 0.0])
    arm_knots = np.cumsum([0.0, measures.upper_arm, measures.forearm])
    leg_knots = np.cumsum([0.0, measures.thigh, measures.shank])
    hand_knots = arm_knots[2] + np.array([0.0, measures.hand])
    skull_knots = at["skullbase"][1] + np.array([0.0, 0.01 * measures.stature])
    sole = np.array([hip[0], ankle[1] + measures.ankle_height])
    centre = np.zeros(2)

    def loft(part: Part, knots: Array, origin: Array) -> Loft:
        return _placed(part, knots, origin, measures)

    return Shape(
        middle=(
            _broadened(loft(TRUNK, trunk_knots, centre), measures),
            loft(NECK, trunk_knots, centre),
            loft(SKULL, skull_knots, centre),
            loft(JAW, skull_knots, centre),
        ),
        girdle=(
            loft(SHOULDER, np.array([0.0, shoulder[0]]), shoulder[1:]),
            loft(BUTTOCK, trunk_knots, centre),
        ),
        arm=(
            loft(ARM, arm_knots, centre),
            loft(HAND, hand_knots, centre),
            loft(THUMB, hand_knots, centre),
        ),
        leg=(
            loft(LEG, leg_knots, np.array([hip[0], 0.0])),
            loft(FOOT, ankle[2] + np.array([0.0, measures.foot]), sole),
        ),
        t_arm=_lowered(shoulder, ARMS_RAISED, np.zeros(3)),
        t_leg=_lowered(hip, LEGS_SPREAD, hip),
        percent=0.01 * measures.stature,
    )


def _placed(part: Part, knots: Array, origin: Array, measures: Measures) -> Loft:
    percent = 0.01 * measures.stature
    rows = np.array(part.rows)
    rows[:, 0] = _at_knots(rows[:, 0], knots)
    rows[:, 1:3] = origin + percent * rows[:, 1:3]
    rows[:, 3:] *= percent * (measures.girth if part.clothed else 1.0)
    return Loft(part.axis, rows, (percent * part.caps[0], percent * part.caps[1]))


def _at_knots(position: Array, knots: Array) -> Array:
    """Metres for positions in units of knots, extrapolated linearly beyond the ends."""
    first = np.clip(np.floor(position).astype(np.int64), 0, len(knots) - 2)
    return np.asarray(knots[first] + (position - first) * (knots[first + 1] - knots[first]))


def _broadened(trunk: Loft, measures: Measures) -> Loft:
    """The trunk, broadened like the hips below and like the shoulders above."""
    usual = FRACTIONS_OF_STATURE
    hips = measures.hip_width / (usual["hip_width"] * measures.stature)
    shoulders = measures.shoulder_width / (usual["shoulder_width"] * measures.stature)
    rows = trunk.sections.copy()
    rows[:, 3] *= np.interp(rows[:, 0], [-measures.trunk, 0.0], [shoulders, hips])
    return Loft(trunk.axis, rows, trunk.caps)


def _lowered(centre: Array, angle: float, to: Array) -> Array:
    """Transform (3, 4) that lowers a left limb by `angle` about `centre`, and moves `centre` to `to`."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.column_stack([turn, to - turn @ centre])


def moved(t: Array, points: Array) -> Array:
    """Points (n, 3) or (3,) after a transform (3, 4)."""
    return np.asarray(points @ t[:, :3].T + t[:, 3])
