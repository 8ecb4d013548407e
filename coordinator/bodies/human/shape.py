"""Signed distance to a person of given measures, in the building pose.

In the building pose the arms are raised to `ARMS_RAISED` from the vertical and the legs are spread by
`LEGS_SPREAD`, half-way between the poses that people take, so that armpits and crotch are open.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coordinator.bodies.human import outline
from coordinator.bodies.human.loft import Loft, smooth_union
from coordinator.bodies.human.measures import FRACTIONS_OF_STATURE, Measures
from coordinator.bodies.human.outline import Part
from coordinator.bodies.human.skeleton import Skeleton

Array = NDArray[np.float64]

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
    """The outline placed on the joints of a person of these measures."""
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
            _broadened(loft(outline.TRUNK, trunk_knots, centre), measures),
            loft(outline.NECK, trunk_knots, centre),
            loft(outline.SKULL, skull_knots, centre),
            loft(outline.JAW, skull_knots, centre),
        ),
        girdle=(
            loft(outline.SHOULDER, np.array([0.0, shoulder[0]]), shoulder[1:]),
            loft(outline.BUTTOCK, trunk_knots, centre),
        ),
        arm=(
            loft(outline.ARM, arm_knots, centre),
            loft(outline.HAND, hand_knots, centre),
            loft(outline.THUMB, hand_knots, centre),
        ),
        leg=(
            loft(outline.LEG, leg_knots, np.array([hip[0], 0.0])),
            loft(outline.FOOT, ankle[2] + np.array([0.0, measures.foot]), sole),
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
    """Metres for positions counted in knots, going on beyond the ends at the same rate."""
    first = np.clip(np.floor(position).astype(np.int64), 0, len(knots) - 2)
    return np.asarray(knots[first] + (position - first) * (knots[first + 1] - knots[first]))


def _broadened(trunk: Loft, measures: Measures) -> Loft:
    """The trunk as much broader as the hips are below, and as the shoulders are above."""
    usual = FRACTIONS_OF_STATURE
    hips = measures.hip_width / (usual["hip_width"] * measures.stature)
    shoulders = measures.shoulder_width / (usual["shoulder_width"] * measures.stature)
    rows = trunk.sections.copy()
    rows[:, 3] *= np.interp(rows[:, 0], [-measures.trunk, 0.0], [shoulders, hips])
    return Loft(trunk.axis, rows, trunk.caps)


def _lowered(centre: Array, angle: float, to: Array) -> Array:
    """(3, 4) that lowers a left limb, raised sideways by `angle` about `centre`, and puts that at `to`."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.column_stack([turn, to - turn @ centre])


def moved(t: Array, points: Array) -> Array:
    """Points (n, 3) or (3,) after a transform (3, 4)."""
    return np.asarray(points @ t[:, :3].T + t[:, 3])
