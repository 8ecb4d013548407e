"""Whoever may be a person in a scene, before anything is known of a body.

Parts of the picture that hang together, no part of floor, walls or background, with a person's extent and
area, and not flat as furniture is. What something nearer cuts in two is joined by where it stands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coordinator.scene.noise import LEAST
from coordinator.scene.people.components import Component, components, largest_plane, united
from coordinator.scene.people.faces import flat_faces
from coordinator.scene.room.marks import FOREGROUND, mark_room
from coordinator.scene.view import SceneView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LONGEST = (0.6, 2.5)  # metres, of a person's greatest extent
AREA = (0.1, 1.6)  # square metres that are seen
USUAL_LONGEST, USUAL_AREA = 1.6, 0.5
LOOSE_LONGEST, LOOSE_AREA = 0.4, 0.7  # standard deviations of their logarithms
FLAT = 0.8  # share in one plane from which on it is furniture
RAGGED, COMPACT = 0.65, 0.9  # share of pixels with neighbours all round: of noise, and of a person
ASIDE = 0.5  # tangent of the angle from the middle of the picture to where people stand less often
SPREAD = 0.005  # metres off a plane, the noise aside
PEELED = 0.25  # share of what is too large that a plane must hold to be taken away
PEELS = 3
TOGETHER = 0.35  # metres along the floor between two parts of one person
STICKS_OUT = 0.4  # metres that the smaller of them may reach farther to a side: what does is the floor's


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """Somebody, perhaps.

    mask: (H, W) the pixels. points: (P, 3) the same in the camera frame, metres. box: (2, 3) around them.
    score: from 0 to 1. why: its measures in words.
    """

    mask: Mask
    points: Array
    box: Array
    score: float
    why: str


def foreground(view: SceneView) -> Mask:
    """Pixels (H, W) that are no part of floor, walls or background."""
    marks = np.empty(view.depth.shape, dtype=np.uint8)
    mark_room(view.depth, view.background, view.lens, view.planes.coefficients, view.noise.growth, marks)
    found: Mask = marks == FOREGROUND
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """What of the foreground hangs together and is no larger than a person; the same without flat faces.

    flat: (H, W) these faces.
    """

    whole: list[Component]
    bare: list[Component]
    flat: Mask


def take_apart(view: SceneView, known: Mask | None = None) -> Parts:
    """The parts of a frame, without pixels (H, W) of which it is known whose they are."""
    free = foreground(view) if known is None else foreground(view) & ~known
    whole = [piece for part in components(view, free) for piece in peel(view, part)]
    flat = np.zeros_like(free)
    for part in whole:
        if of_a_persons_size(part):
            flat |= flat_faces(view, part)
    return Parts(whole, [piece for part in whole for piece in without(view, part, flat)], flat)


def candidates(view: SceneView, known: Mask | None = None) -> list[Candidate]:
    """Who may be a person, best first; nobody of whom the pixels (H, W) are known."""
    return likeliest(view, take_apart(view, known))


def likeliest(view: SceneView, parts: Parts) -> list[Candidate]:
    """Who of a frame's parts may be a person, without flat faces, best first."""
    found = [judge(view, each) for each in join(view, parts.bare) if of_a_persons_size(each)]
    return sorted((each for each in found if each is not None), key=lambda each: -each.score)


def somebodys(view: SceneView, parts: Parts) -> Mask:
    """Pixels (H, W) of whoever may be a person, with what hangs together with them but for flat faces."""
    found = np.zeros_like(parts.flat)
    for part in [*join(view, parts.whole), *join(view, parts.bare)]:
        if of_a_persons_size(part) and judge(view, part) is not None:
            found |= part.mask(view)
    return found & ~parts.flat


def without(view: SceneView, part: Component, flat: Mask) -> list[Component]:
    """What hangs together of a part without its flat faces; the part itself where it has none."""
    mask = part.mask(view)
    return components(view, mask & ~flat) if (mask & flat).any() else [part]


def of_a_persons_size(part: Component) -> bool:
    """Whether extent and area are a person's."""
    return LONGEST[0] <= part.longest <= LONGEST[1] and AREA[0] <= part.area <= AREA[1]


def judge(view: SceneView, part: Component) -> Candidate | None:
    """A candidate of a part's measures; None if it is as flat as furniture."""
    spread = spread_of(view, part)
    _, flat = largest_plane(part.points, spread)
    if flat >= FLAT:
        return None
    compact = min(1.0, max(0.0, (part.compact - RAGGED) / (COMPACT - RAGGED)))
    score = (
        compact
        * centred(part)
        * likeness(part.longest, USUAL_LONGEST, LOOSE_LONGEST)
        * likeness(part.area, USUAL_AREA, LOOSE_AREA)
        * min(1.0, (FLAT - flat) / (FLAT - USUALLY_FLAT))
    )
    across, height, away = part.size
    why = (
        f"{height:.2f} m high, {across:.2f} m wide, {away:.2f} m deep, {part.area:.2f} m2 seen, "
        f"{100 * flat:.0f} % in one plane"
    )
    box = np.array([part.points.min(axis=0), part.points.max(axis=0)])
    return Candidate(part.mask(view), part.points, box, float(score), why)


USUALLY_FLAT = 0.6


def likeness(value: float, usual: float, loose: float) -> float:
    """From 0 to 1: how usual a size is, by its logarithm."""
    return float(np.exp(-0.5 * (np.log(value / usual) / loose) ** 2))


def centred(part: Component) -> float:
    """From 0 to 1: how near to the middle of the picture a part is, where whoever is recorded stands."""
    x, y, z = part.points.mean(axis=0)
    return float(np.exp(-0.5 * ((x * x + y * y) / (z * z)) / ASIDE**2))


def spread_of(view: SceneView, part: Component) -> float:
    """How far the noise carries points off a plane at this distance, metres."""
    z = float(np.median(part.points[:, 2]))
    return 2.0 * (LEAST + view.noise.growth * z * z) + SPREAD


def peel(view: SceneView, part: Component) -> list[Component]:
    """A part; or, where it is too large for a person, its pieces without its largest planes."""
    whole = [part]
    for _ in range(PEELS):
        pieces = []
        for each in whole:
            if each.longest <= LONGEST[1] and each.area <= AREA[1]:
                pieces.append(each)
                continue
            plane, share = largest_plane(each.points, spread_of(view, each))
            if share < PEELED:
                continue
            rest = each.mask(view)
            rest[rest] = np.abs(each.points @ plane[:3] + plane[3]) > spread_of(view, each) * 2.0
            pieces.extend(components(view, rest))
        if len(pieces) == len(whole) and all(a is b for a, b in zip(pieces, whole, strict=True)):
            break
        whole = pieces
    return whole


def join(view: SceneView, parts: list[Component]) -> list[Component]:
    """Parts, of which those are one that stand on the same spot with something nearer between them."""
    rest, joined = list(parts), []
    while rest:
        one = rest.pop(0)
        for other in list(rest):
            if same_spot(one, other) and hidden_between(view, one, other):
                rest.remove(other)
                one = united(view, one, other)
        joined.append(one)
    return joined


def same_spot(one: Component, other: Component) -> bool:
    """Whether two parts stand above each other, and are together no taller than a person, nor much wider."""
    apart = np.linalg.norm((one.middle - other.middle)[[0, 2]])
    tall = max(one.high[1], other.high[1]) - min(one.low[1], other.low[1])
    large, small = (one, other) if one.area > other.area else (other, one)
    beyond = np.maximum(large.low - small.low, small.high - large.high)[[0, 2]].max()
    return bool(apart < TOGETHER and tall < LONGEST[1] and beyond < STICKS_OUT)


def hidden_between(view: SceneView, one: Component, other: Component) -> bool:
    """Whether something nearer than both is seen on the way from the middle of one to that of the other."""
    masks = [part.mask(view) for part in (one, other)]
    ends = [np.argwhere(mask).mean(axis=0) for mask in masks]
    steps = np.linspace(ends[0], ends[1], 64).round().astype(int)
    between = view.depth[steps[:, 0], steps[:, 1]]
    apart = ~(masks[0] | masks[1])[steps[:, 0], steps[:, 1]] & (between > 0.0)
    nearest = min(float(np.percentile(part.points[:, 2], 5.0)) for part in (one, other))
    return bool(np.any(between[apart] < nearest))
