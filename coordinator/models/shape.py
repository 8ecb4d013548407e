"""The outline of a clothed adult as tables of sections, and its signed distance in the building pose.

In the building pose the arms are raised to `ARMS_RAISED` from the vertical and the legs are spread by
`LEGS_SPREAD`, half-way between the poses that people take, so that armpits and crotch are open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coordinator.models.loft import Loft, smooth_union
from coordinator.models.measures import Measures
from coordinator.models.skeleton import ARM_TILT, Skeleton

Array = NDArray[np.float64]

ARMS_RAISED, LEGS_SPREAD = np.radians(48.0), np.radians(5.0)

# Columns: position along the part, centre and half-width of the section in the two other coordinates.
# Widths and centres are in percent of stature.
#          height  x    z    half-widths x, z          height in units of the trunk, above the hips
_TRUNK = (
    (-0.13, 0.0, 0.9, 8.6, 5.6),
    (0.03, 0.0, 0.8, 9.5, 6.2),
    (0.20, 0.0, 0.2, 9.2, 6.0),
    (0.38, 0.0, 0.0, 8.6, 5.8),
    (0.55, 0.0, 0.3, 8.9, 6.1),
    (0.72, 0.0, 0.3, 9.4, 6.8),
    (0.86, 0.0, 0.8, 9.3, 6.6),
    (0.97, 0.0, 1.2, 8.2, 5.6),
    (1.06, 0.0, 1.5, 6.2, 4.6),
    (1.12, 0.0, 1.5, 4.4, 3.9),
)
_NECK = (
    (1.04, 0.0, 1.6, 3.5, 3.7),
    (1.15, 0.0, 1.1, 3.2, 3.5),
    (1.30, 0.0, 0.3, 3.1, 3.5),
    (1.42, 0.0, -0.1, 3.0, 3.4),
)
_BUTTOCK = ((-0.19, 4.3, 2.9, 3.2, 2.8), (-0.05, 4.3, 3.4, 4.4, 4.2), (0.10, 4.2, 2.8, 4.2, 3.8))
#          height above the base of the skull in percent of stature
_HEAD = (
    (-4.0, 0.0, -3.0, 1.9, 1.9),
    (-2.6, 0.0, -2.1, 3.1, 3.5),
    (-0.8, 0.0, -1.0, 3.8, 5.0),
    (1.6, 0.0, -0.6, 4.2, 5.7),
    (4.0, 0.0, -0.3, 4.5, 5.9),
    (6.0, 0.0, -0.1, 4.1, 5.3),
    (7.5, 0.0, 0.0, 2.7, 3.6),
)
#          sideways, in units of half the shoulder width; centres y, z relative to the shoulder joint
_SHOULDER = ((0.10, -3.0, 0.2, 3.0, 3.6), (0.45, -1.7, 0.1, 3.0, 3.8), (0.85, -0.5, 0.0, 3.0, 3.6))
#          down the arm: 0 shoulder, 1 elbow, 2 wrist
_ARM = (
    (-0.02, 0.1, 0.0, 3.1, 3.5),
    (0.30, 0.0, -0.1, 2.9, 3.3),
    (0.62, 0.0, -0.1, 2.7, 3.0),
    (1.00, 0.0, 0.1, 2.4, 2.6),
    (1.25, 0.0, 0.0, 2.5, 2.8),
    (1.60, 0.0, 0.0, 2.1, 2.3),
    (1.95, 0.0, 0.0, 1.6, 1.9),
    (2.05, 0.0, 0.0, 1.5, 1.9),
)
#          down the hand, in units of its length
_HAND = (
    (0.02, 0.0, 0.0, 1.4, 1.8),
    (0.28, 0.0, 0.0, 1.2, 2.3),
    (0.48, -0.1, 0.0, 1.1, 2.4),
    (0.72, -0.3, 0.0, 0.95, 2.2),
    (0.90, -0.6, 0.0, 0.8, 1.7),
)
_THUMB = ((0.15, -0.1, -1.4, 0.9, 1.0), (0.35, -0.3, -2.5, 0.85, 0.95), (0.52, -0.4, -3.1, 0.75, 0.8))
#          down the leg: 0 hip, 1 knee, 2 ankle; centre x relative to the hip joint
_LEG = (
    (0.00, -0.1, 0.8, 4.7, 5.2),
    (0.18, -0.1, 0.7, 4.7, 5.2),
    (0.45, 0.0, 0.4, 4.3, 4.7),
    (0.75, 0.0, 0.3, 3.7, 4.0),
    (0.97, 0.0, 0.2, 3.3, 3.6),
    (1.08, 0.0, 0.5, 3.1, 3.5),
    (1.32, 0.1, 1.3, 3.2, 3.5),
    (1.58, 0.0, 1.4, 2.8, 3.0),
    (1.85, 0.0, 1.4, 2.3, 2.5),
    (2.00, 0.0, 1.4, 2.2, 2.5),
)
#          backward from the ankle, in units of the foot; centre y above the sole
_FOOT = (
    (-0.70, -0.1, -1.0, 1.9, 1.0),
    (-0.52, 0.0, -1.3, 2.7, 1.3),
    (-0.36, 0.0, -1.6, 2.7, 1.6),
    (-0.15, 0.0, -2.1, 2.3, 2.1),
    (0.05, 0.0, -2.3, 2.1, 2.3),
    (0.18, 0.0, -1.9, 1.9, 1.9),
)


@dataclass(frozen=True)
class Shape:
    """Parts of the body: those in the middle, and those of the left side by the limb they are part of."""

    middle: tuple[Loft, ...]
    girdle: tuple[Loft, ...]
    arm: tuple[Loft, ...]
    leg: tuple[Loft, ...]
    t_rest_arm: Array  # (3, 4) building pose -> upright arm along the y axis through the shoulder joint
    t_rest_leg: Array  # (3, 4) building pose -> rest
    stature: float

    def distance(self, points: Array) -> Array:
        """Signed distance (n,) to the surface, for points (n, 3) in the building pose."""
        k = 0.01 * self.stature
        both = [_sides(part, points) for part in (self._trunk_side, self._arm_side, self._leg_side)]
        trunk = _union([*(loft.distance(points) for loft in self.middle), both[0]], 2.0 * k)
        return smooth_union(smooth_union(trunk, both[2], 2.5 * k), both[1], 3.0 * k)

    def _trunk_side(self, points: Array) -> Array:
        return _union([loft.distance(points) for loft in self.girdle], 2.0 * self.stature * 0.01)

    def _arm_side(self, points: Array) -> Array:
        hanging = points @ self.t_rest_arm[:, :3].T + self.t_rest_arm[:, 3]
        return _union([loft.distance(hanging) for loft in self.arm], 0.008 * self.stature)

    def _leg_side(self, points: Array) -> Array:
        standing = points @ self.t_rest_leg[:, :3].T + self.t_rest_leg[:, 3]
        return _union([loft.distance(standing) for loft in self.leg], 0.015 * self.stature)


def _sides(part, points: Array) -> Array:  # type: ignore[no-untyped-def]
    """Union of a left part with its mirror image."""
    return smooth_union(part(points), part(points * (-1.0, 1.0, 1.0)), 0.012)


def _union(distances: list[Array], width: float) -> Array:
    total = distances[0]
    for distance in distances[1:]:
        total = smooth_union(total, distance, width)
    return total


def shape_person(measures: Measures, skeleton: Skeleton) -> Shape:
    """The outline for these measures."""
    joints, percent = skeleton.joints, 0.01 * measures.stature
    wide = percent * measures.girth
    shoulder, wrist, hip, ankle = (joints[f"l_{name}"] for name in ("shoulder", "wrist", "hip", "ankle"))
    arm = np.array([0.0, measures.upper_arm, measures.upper_arm + measures.forearm])
    leg = np.array([0.0, measures.thigh, measures.thigh + measures.shank])
    trunk = measures.trunk
    skullbase = joints["skullbase"]

    def upward(table: tuple[tuple[float, ...], ...], unit: float, scale: float, origin: Array) -> Loft:
        rows = np.array(table[::-1])
        rows[:, 0] = origin[1] - unit * rows[:, 0]
        return Loft(1, _placed(rows, scale, origin[[0, 2]]), _caps(rows, scale, 0.7))

    def downward(table: tuple[tuple[float, ...], ...], knots: Array, scale: float, origin: Array) -> Loft:
        rows = np.array(table)
        rows[:, 0] = origin[1] + _beyond(rows[:, 0], knots)
        return Loft(1, _placed(rows, scale, origin[[0, 2]]), _caps(rows, scale, 0.8))

    middle = np.zeros(3)
    hanging = np.array([0.0, 0.0, 0.0])
    down_arm = np.array([0.0, float(arm[2]), 0.0])
    hand = np.array([0.0, measures.hand])
    girdle_rows = np.array(_SHOULDER)
    girdle_rows[:, 0] *= shoulder[0]
    foot_rows = np.array(_FOOT)
    foot_rows[:, 0] = ankle[2] + foot_rows[:, 0] * measures.foot
    sole = np.array([hip[0], ankle[1] + measures.ankle_height])
    return Shape(
        middle=(
            upward(_TRUNK, trunk, wide, middle),
            upward(_NECK, trunk, percent, middle),
            upward(_HEAD, percent, percent, skullbase * (1, 1, 0)),
        ),
        girdle=(
            Loft(0, _placed(girdle_rows, wide, shoulder[1:]), _caps(girdle_rows, wide, 0.7)),
            upward(_BUTTOCK, trunk, wide, middle),
        ),
        arm=(
            downward(_ARM, arm, wide, hanging),
            downward(_HAND, hand, percent, down_arm),
            downward(_THUMB, hand, percent, down_arm),
        ),
        leg=(
            downward(_LEG, leg, wide, hip * (1, 1, 0)),
            Loft(2, _placed(foot_rows, percent, sole), _caps(foot_rows, percent, 0.9)),
        ),
        t_rest_arm=_turned_about(shoulder, ARMS_RAISED, to_origin=True),
        t_rest_leg=_turned_about(hip, LEGS_SPREAD),
        stature=measures.stature,
    )


def _beyond(position: Array, knots: Array) -> Array:
    """Lengths for positions counted in knots, going on beyond the last knots at the same rate."""
    first = np.clip(np.floor(position).astype(np.int64), 0, len(knots) - 2)
    return np.asarray(knots[first] + (position - first) * (knots[first + 1] - knots[first]))


def _placed(rows: Array, scale: float, centre: Array) -> Array:
    placed = rows.copy()
    placed[:, 1:] *= scale
    placed[:, 1:3] += centre
    return placed


def _caps(rows: Array, scale: float, roundness: float) -> tuple[float, float]:
    return roundness * scale * float(rows[0, 3:].min()), roundness * scale * float(rows[-1, 3:].min())


def _turned_about(centre: Array, angle: float, to_origin: bool = False) -> Array:
    """(3, 4) that lowers a left limb raised sideways by `angle` about `centre`."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    shift = -turn @ centre if to_origin else centre - turn @ centre
    return np.column_stack([turn, shift])


BUILDING_ABDUCTION = {"shoulder": ARMS_RAISED - ARM_TILT, "hip": LEGS_SPREAD}
"""How far each limb must be abducted from rest to be in the building pose, in radians."""
