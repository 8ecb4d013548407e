"""Seats that are placed around posed people: chairs, boxes and wheelchairs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.furniture.parts import THICK_M, Part, Range, block, disc, legs, post, rim
from benchmarks.furniture.people import DRAWING, Posed


def seat_down(person: Posed, seat: float | None) -> float:
    """Lift the person onto a seat of this height, metres, or one that has the feet on the floor.

    Returns the height. If the legs are too long for the seat, it is higher.
    """
    thighs = person.surface("pelvis", "thigh")
    needed = float(person.vertices[..., 1].max() - thighs[..., 1].max()) + DRAWING.pressed_m
    height = needed if seat is None else max(seat, needed)
    person.shift(y=-height - float(thighs[..., 1].max()) + DRAWING.pressed_m)
    return height


def seat_of(person: Posed) -> tuple[Range, Range]:
    """Sides and ends of a seat: x, and z from the back of the knees to behind the buttocks."""
    hips = person.surface("pelvis", "thigh")
    wide = 0.5 * float(np.ptp(hips[..., 0]))
    rear = float(person.trunk[..., 2].max()) + 0.005
    calves = float(person.surface("shank")[..., 2].max()) + 0.01
    half = max(0.19, 0.85 * wide)
    return (-half, half), (calves, rear)


def back_of(x: Range, rear: float, seat: float, rng: np.random.Generator) -> Iterator[Part]:
    """The back of a chair behind the trunk: a board, or posts with slats."""
    top = seat + rng.uniform(0.35, 0.55)
    if rng.random() < 0.5:
        yield block(x, (rear, rear + 0.03), (seat + rng.choice([0.0, 0.12]), top))
    else:
        half = 0.5 * THICK_M
        for side in (x[0] + half, x[1] - half):
            yield post(side, rear + half, (seat, top))
        for high in np.linspace(seat + 0.15, top - 0.06, int(rng.integers(2, 4))):
            yield block(x, (rear, rear + 0.02), (high, high + 0.06))


def chair_for(person: Posed, seat: float, rng: np.random.Generator) -> list[Part]:
    """A chair with four legs, a seat and a back."""
    x, z = seat_of(person)
    behind = (z[0], z[1] + THICK_M)
    return [block(x, behind, (seat - 0.04, seat)), *legs(x, behind, seat), *back_of(x, z[1], seat, rng)]


def box_for(person: Posed, seat: float, rng: np.random.Generator) -> list[Part]:
    """A box without a back."""
    x, z = seat_of(person)
    return [block(x, (z[0], z[1] + rng.uniform(0.0, 0.1)), (0.0, seat))]


def usual_seat(rng: np.random.Generator) -> float:
    """Height of a seat for adults, on which the feet of children hang."""
    return float(rng.uniform(0.40, 0.46))


def wheelchair_for(person: Posed, seat: float, rng: np.random.Generator) -> list[Part]:
    """Seat, back, arm rests, two large wheels, two small ones, foot plates."""
    (left, right), (front, rear) = seat_of(person)
    hips = person.surface("pelvis", "thigh")[..., 0]
    left, right = min(left, float(hips.min()) - 0.01), max(right, float(hips.max()) + 0.01)
    made = [
        block((left, right), (front, rear), (seat - 0.03, seat)),
        block((left, right), (rear, rear + 0.03), (seat, seat + rng.uniform(0.38, 0.5))),
    ]
    arms, radius, wide = seat + rng.uniform(0.16, 0.22), rng.uniform(0.27, 0.31), 0.025
    axle, spoked = rear - rng.uniform(0.02, 0.12), rng.random() < 0.5
    for edge, out in ((left, -1.0), (right, 1.0)):
        side = between(edge, edge + 0.04 * out)
        made.append(block(side, (front + 0.05, rear), (arms - 0.03, arms)))
        made.append(
            block(between(edge, edge + 0.015 * out), (front + 0.12, rear), (seat - 0.03, arms - 0.02))
        )
        made.append(post(edge + 0.02 * out, front + 0.07, (seat - 0.03, arms - 0.02)))
        wheel = between(edge + 0.05 * out, edge + (0.05 + wide) * out)
        made += rim(wheel, axle, radius, radius) if spoked else [disc(wheel, axle, radius, radius)]
        small = between(edge - 0.03 * out, edge)
        made.append(disc(small, front - 0.02, 0.08, 0.08))
        made.append(post(edge - 0.0175 * out, front - 0.02, (0.12, seat - 0.03)))
    feet = person.surface("foot", "toes")
    lowest = -float(person.vertices[..., 1].max())
    x, z = (
        (float(feet[..., 0].min()), float(feet[..., 0].max())),
        (float(feet[..., 2].min()), float(feet[..., 2].max())),
    )
    plate = (max(0.0, lowest - 0.02), lowest + DRAWING.pressed_m)
    made.append(block((x[0] - 0.01, -0.01), z, plate))
    made.append(block((0.01, x[1] + 0.01), z, plate))
    return made


def between(a: float, b: float) -> Range:
    """The range of two ends in any order."""
    return min(a, b), max(a, b)
