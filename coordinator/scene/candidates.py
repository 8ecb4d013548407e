"""Candidates for people in a frame, before a body is known.

A candidate is a connected component of the foreground that has the extent and area of a person and, unlike
furniture, is not flat. Flat furniture that a person touches is cut off. A limb may hide where the parts of a
body are connected. So a candidate is joined with parts above or below it, and the remaining foreground is
divided again, only at steps that are larger than those between parts of one body.

A limb may also be separated by a large step, and a flat chest may be taken for furniture. Only a fitted body
can tell. So a candidate also has wider masks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, minimum_filter

from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics, points_of
from gepf.coordinator.scene.flatness import FLAT_SHARE, LEAST_PART_M2, SAMPLED, Flat, find_flat
from gepf.coordinator.scene.planes import extents
from gepf.coordinator.scene.scene import FOREGROUND, PERSON_LENGTH_M, SceneView
from gepf.coordinator.scene.segmentation import (
    CELL_M,
    LEAST_AREA_M2,
    NEAR_M,
    REACH_M,
    STEP_M,
    label_parts,
    measure_components,
)

PERSON_AREA_M2 = LEAST_AREA_M2, 1.6  # least and most visible area of a person
LIMB_STEP_M = 0.8  # largest step in depth from the outline of a body to its own limb
SAME_SPOT_M = 0.35  # horizontal distance of a further part of a person, with an occluder between


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A connected component of the foreground.

    mask: (H, W) its pixels in a window of the frame. points: (P, 3) their points in the camera frame, metres.
    middle, heights: their median (3,), and the ends of their vertical range, in the level camera frame.
    uncut: (H, W) the pixels of the component before flat parts were cut off.
    """

    window: tuple[slice, slice]
    mask: Mask
    uncut: Mask
    points: Array
    middle: Array
    heights: tuple[float, float]

    @property
    def height(self) -> float:
        """The vertical range, metres."""
        return self.heights[1] - self.heights[0]

    @property
    def pixel(self) -> Array:
        """Mean row and column (2,) of its pixels in the frame."""
        rows, columns = self.window
        return np.asarray(np.argwhere(self.mask).mean(axis=0) + np.array([rows.start, columns.start]))

    def mark(self, mask: Mask) -> None:
        """Set the pixels of the part in a mask of the whole frame."""
        mask[self.window] |= self.mask


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A candidate for a person.

    mask: (H, W) its pixels. points: (P, 3) their points in the camera frame, metres. score: from 0 to 1.
    why: its measures as text. part: the component with the trunk, without furniture. wider: masks (H, W) with
    more of what may be the person's: the parts that touch the outline, then also the flat parts.
    """

    mask: Mask
    points: Array
    part: Part
    score: float
    why: str
    wider: tuple[Mask, ...] = ()

    @property
    def widest(self) -> Mask:
        """All pixels (H, W) that may be the person's."""
        return self.wider[-1] if self.wider else self.mask


def candidates(view: SceneView, known: Mask | None = None) -> list[Candidate]:
    """Candidates for people, best first; pixels (H, W) of known people are excluded."""
    free = view.marks == FOREGROUND
    if known is not None:
        free &= ~known
    parts = find_parts(view, free, STEP_M, LEAST_PART_M2)
    found = [each for part in parts if (each := candidate_of(view, part))]
    rest = free.copy()
    for each in found:
        rest[each.part.window] &= ~each.part.uncut
    wider = find_parts(view, rest, REACH_M, PERSON_AREA_M2[0])
    found += [each for part in wider if (each := candidate_of(view, part))]
    people, taken = list[Candidate](), np.zeros_like(free)
    for each in sorted(found, key=lambda each: -each.score):
        if 2 * np.count_nonzero(taken & each.mask) < np.count_nonzero(each.mask):
            others = [part for part in parts if not (taken[part.window] & part.mask).any()]
            people.append(widen(view, join_parts(view, each, others), others))
            taken |= people[-1].mask
    return people


def find_parts(view: SceneView, free: Mask, step: float, least_m2: float) -> list[Part]:
    """The connected components of pixels (H, W), without flat furniture.

    Neighbours are connected if their depths differ by less than a step, metres. Components with a smaller
    visible area than the least, square metres, and those larger than a person are left out.
    """
    labels = label_parts(view.depth, free, step, view.growth, view.camera.fx)
    areas, windows = measure_components(labels, view.depth, view.camera.fx, view.camera.fy)
    found = list[Part]()
    for label in np.flatnonzero((areas >= least_m2) & (areas <= PERSON_AREA_M2[1])).tolist():
        left, top, right, bottom = windows[label].tolist()
        window = slice(top, bottom), slice(left, right)
        mask = labels[window] == label
        part = part_of(view, mask, window, mask)
        found += cut(view, part) if areas[label] >= PERSON_AREA_M2[0] else [part]
    return found


def part_of(view: SceneView, mask: Mask, window: tuple[slice, slice], uncut: Mask) -> Part:
    """The component with these pixels (H, W) of a window."""
    points = points_of(view.depth[window], camera_of(view, window), mask)
    level = points @ view.planes.level.T
    heights = float(level[:, 1].min()), float(level[:, 1].max())
    return Part(window, mask, uncut, points, np.median(level, axis=0), heights)


def camera_of(view: SceneView, window: tuple[slice, slice]) -> Intrinsics:
    """The camera of a window."""
    rows, columns = window
    return view.camera.crop(columns.start, rows.start, columns.stop, rows.stop)


def cut(view: SceneView, part: Part) -> list[Part]:
    """The parts of a component that are not flat, without flat furniture.

    A flat patch is furniture that touches a person if the rest is as high as before, or at least a metre
    high. Small parts are dropped. If no rest is so high, the patch may be a seat on the floor, with a person
    around it. Else the component is kept whole, or dropped if most of it is flat.
    """
    depth = view.depth[part.window]
    flat = find_flat(depth, part.mask, camera_of(view, part.window), view.growth)
    rests = list[Part]()
    if flat.patches.max() >= LEAST_AREA_M2:
        others = part.mask & ~flat.grow(flat.patches >= LEAST_PART_M2)
        labels = label_parts(depth, others, STEP_M, view.growth, view.camera.fx)
        areas, _ = measure_components(labels, depth, view.camera.fx, view.camera.fy)
        large = np.flatnonzero(areas >= LEAST_AREA_M2).tolist()
        rests = [part_of(view, labels == label, part.window, part.uncut) for label in large]
    if max((rest.height for rest in rests), default=0.0) >= min(1.0, part.height):
        return [one for rest in rests for one in cut(view, rest)]
    others = part.mask & ~flat.grow(find_seat(view, part, flat))
    if 0 < np.count_nonzero(others) < len(part.points):
        rest = part_of(view, others, part.window, part.uncut)
        if rest.height >= part.height - CELL_M:
            kept = cut(view, rest)
            if any(candidate_of(view, one) for one in kept):
                return kept
    return [] if flat.share > FLAT_SHARE else [part]


def find_seat(view: SceneView, part: Part, flat: Flat) -> Mask:
    """The flat patches (H, W) of a component that reach down to the floor and are wider than a leg.

    A leg has 9 cm for each metre of the component's height.
    """
    patches, floor = flat.patches >= LEAST_PART_M2, view.planes.above(part.points) < CELL_M
    if not view.planes.has_floor or not floor.any():
        return np.zeros_like(patches)
    labels = label_parts(view.depth[part.window], patches, STEP_M, view.growth, view.camera.fx)
    low = labels[part.mask][floor]
    wide = labels[minimum_filter(patches, max(1, int(flat.size * part.height)), mode="constant")]
    return np.asarray(patches & np.isin(labels, np.intersect1d(low, wide)))


def join_parts(view: SceneView, person: Candidate, parts: Sequence[Part]) -> Candidate:
    """Join the candidate with parts at the same place: above it, below it, or behind something nearer.

    A head, a trunk and legs are such parts if a shoulder or a forearm hides where they are connected. Parts
    that may be two people are not joined.
    """
    own, mask, joined = person.part, person.mask.copy(), [person.part]
    (low, high), half = own.heights, 0.5 * PERSON_LENGTH_M[1]
    for part in parts:
        (bottom, top), across = part.heights, own.middle - part.middle
        lowest, highest = min(low, bottom), max(high, top)
        far = np.linalg.norm(across[[0, 2]]) >= SAME_SPOT_M or highest - lowest >= PERSON_LENGTH_M[1]
        if far or (mask[part.window] & part.mask).any():
            continue
        smaller, larger = sorted((own.height, part.height))
        shared = min(high, top) - max(low, bottom)
        adjoins = -NEAR_M < shared < 0.5 * smaller and (smaller < PERSON_LENGTH_M[0] or larger < half)
        if adjoins or is_behind(view, joined, part):
            part.mark(mask)
            joined, low, high = [*joined, part], lowest, highest
    return replace(person, mask=mask, points=np.concatenate([each.points for each in joined]))


def widen(view: SceneView, person: Candidate, parts: Sequence[Part]) -> Candidate:
    """The candidate with its wider masks."""
    touched, around = person.mask.copy(), dilated(person.mask)
    for part in parts:
        if touches(view, person.mask, around, part):
            part.mark(touched)
    whole = touched.copy()
    whole[person.part.window] |= person.part.uncut
    pairs = (person.mask, touched), (touched, whole)
    return replace(person, wider=tuple(more for less, more in pairs if not np.array_equal(less, more)))


def touches(view: SceneView, mask: Mask, around: Mask, part: Part) -> bool:
    """Whether a part touches a person in the image, at the depth of a limb.

    mask: (H, W) the person's pixels. around: the same, dilated.
    """
    outline = part.mask & around[part.window]
    if not outline.any():
        return False
    edge = np.zeros_like(mask)
    edge[part.window] = outline
    step = np.median(view.depth[edge]) - np.median(view.depth[mask & dilated(edge)])
    return bool(abs(step) < LIMB_STEP_M)


def dilated(mask: Mask) -> Mask:
    """The pixels (H, W), at least one, with those up to two pixels away."""
    (top, bottom), (left, right) = (np.flatnonzero(mask.any(axis=a))[[0, -1]].tolist() for a in (1, 0))
    box = slice(max(top - 2, 0), bottom + 3), slice(max(left - 2, 0), right + 3)
    wide = np.zeros_like(mask)
    wide[box] = binary_dilation(mask[box], iterations=2)
    return wide


def is_behind(view: SceneView, joined: Sequence[Part], part: Part) -> bool:
    """Whether something nearer is between the joined parts of a person and another part."""
    weights = [len(each.points) for each in joined]
    start = np.average([each.pixel for each in joined], axis=0, weights=weights)
    rows, columns = np.linspace(start, part.pixel, 64).round().astype(int).T
    mask = np.zeros(view.depth.shape, dtype=np.bool_)
    for each in (*joined, part):
        each.mark(mask)
    between = view.depth[rows, columns][~mask[rows, columns]]
    own = np.concatenate([each.points[:, 2] for each in joined])
    nearest = min(float(np.percentile(each, 5.0)) for each in (own, part.points[:, 2]))
    return bool(np.any((between > 0.0) & (between < nearest)))


def candidate_of(view: SceneView, part: Part) -> Candidate | None:
    """The candidate of a part; None if it is too small, too short or too long.

    The score increases towards the middle of the image and with the height up to one metre.
    """
    points = part.points
    seen = float(np.sum(points[:, 2] ** 2)) / (view.camera.fx * view.camera.fy)  # square metres
    if seen < PERSON_AREA_M2[0]:
        return None
    some = points[:: 1 + len(points) // SAMPLED]
    across, height, away = extents(some @ view.planes.level.T).tolist()
    if not PERSON_LENGTH_M[0] <= max(across, height, away) <= PERSON_LENGTH_M[1]:
        return None
    x, y, z = points.mean(axis=0)
    centred = np.exp(-2.0 * (x * x + y * y) / (z * z))
    score = float(centred * min(1.0, height) ** 2)
    why = f"{height:.2f} m high, {across:.2f} m wide, {away:.2f} m deep, {seen:.2f} m2 seen"
    mask = np.zeros(view.depth.shape, dtype=np.bool_)
    part.mark(mask)
    return Candidate(mask, points, part, score, why)
