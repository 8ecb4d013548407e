"""The outline of a clothed adult as tables of elliptic sections.

Rows: position along the part, then the section's centre and half-widths in the two other coordinates (in
the order x, y, z), in percent of stature. At chest, waist and hips, breadths and depths are the means of
both sexes (as fractions of stature) in Gordon et al., "2012 Anthropometric Survey of U.S. Army Personnel"
(NATICK/TR-15/007), plus 1-2 cm of clothes; the rest was drawn by eye to go with them. Caps are the lengths
of the rounded ends before the first and after the last row.
"""

from __future__ import annotations

from dataclasses import dataclass

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
