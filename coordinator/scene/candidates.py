"""Candidates for people in a frame, before a body is known.

A candidate is a connected component of the foreground that has the extent and area of a person and, unlike
furniture, is not flat. Flat furniture that a person touches is cut off; if nothing is left that may be a
person, all but what surely is a body is cut off instead. A limb in front may hide the connection between two
parts of a body. A candidate is therefore merged with parts above or below it, and the remaining foreground is
divided again, but only at depth steps larger than those between parts of one body.

A limb may also be separated by a large step, and a flat chest may be taken for furniture. Only a fitted body
can tell. So a candidate also has wider masks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, minimum_filter

from gepf.common.arrays import Array, Mask
from gepf.common.camera import Intrinsics, points_of
from gepf.coordinator.scene.flatness import FlatPart, find_flat_part
from gepf.coordinator.scene.planes import extents
from gepf.coordinator.scene.scene import FOREGROUND, SceneView
from gepf.coordinator.scene.segmentation import label_parts, measure_components, reach_of

BodyPixels = Callable[[SceneView, Mask], NDArray[np.float32]]
"""How likely each pixel of a mask (H, W) shows a body, from 0 to 1; 0 for all others."""

LIKELY = 0.5  # probability above which a pixel is taken for one of a body
MIN_FLAT_SIDE_M2 = 0.07  # of furniture; a chest or a back has smaller flat parts
SURE = 0.9  # mean probability above which such pixels are a body, where flat parts leave nobody


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A connected component of the foreground.

    mask: (H, W) its pixels in a window of the frame. points: (P, 3) their points in the camera frame, metres.
    middle, y_range: their median (3,), and the upper and the lower end of their vertical range, in the
    levelled camera frame, in which y points down.
    length: their longest extent along an axis of that frame, metres, without outliers.
    uncut: (H, W) the pixels of the component before flat parts were cut off.
    """

    window: tuple[slice, slice]
    mask: Mask
    uncut: Mask
    points: Array
    middle: Array
    y_range: tuple[float, float]
    length: float

    @property
    def height(self) -> float:
        """The vertical range, metres."""
        return self.y_range[1] - self.y_range[0]

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
    description: its dimensions as text. part: the component with the trunk, without furniture. wider: wider
    masks (H, W) of the person: with the parts that touch the outline, then also with the flat parts.
    """

    mask: Mask
    points: Array
    part: Part
    score: float
    description: str
    wider: tuple[Mask, ...] = ()

    @property
    def widest(self) -> Mask:
        """The widest mask (H, W) of the person."""
        return self.wider[-1] if self.wider else self.mask


def find_candidates(
    view: SceneView, people_mask: Mask | None = None, body_pixels: BodyPixels | None = None
) -> list[Candidate]:
    """Candidates for people, best first; pixels (H, W) of tracked people are excluded.

    With `body_pixels`, people whom flat parts would hide are found as well.
    """
    segmentation, free = view.settings.segmentation, view.marks == FOREGROUND
    if people_mask is not None:
        free &= ~people_mask
    parts = find_parts(view, free, segmentation.step_m, view.settings.candidates.min_part_m2, body_pixels)
    candidates = [candidate for part in parts if (candidate := candidate_of(view, part))]
    rest = free.copy()
    for candidate in candidates:
        rest[candidate.part.window] &= ~candidate.part.uncut
    reach_m, min_area_m2 = reach_of(segmentation), segmentation.min_person_m2
    rest_parts = find_parts(view, rest, reach_m, min_area_m2, body_pixels)
    candidates += [candidate for part in rest_parts if (candidate := candidate_of(view, part))]
    people, taken = list[Candidate](), np.zeros_like(free)
    for candidate in sorted(candidates, key=lambda candidate: -candidate.score):
        if 2 * np.count_nonzero(taken & candidate.mask) < np.count_nonzero(candidate.mask):
            unused = [part for part in parts if not (taken[part.window] & part.mask).any()]
            people.append(widen(view, join_parts(view, candidate, unused), unused))
            taken |= people[-1].mask
    return people


def find_parts(
    view: SceneView, free: Mask, step: float, min_area_m2: float, body_pixels: BodyPixels | None
) -> list[Part]:
    """The connected components of pixels (H, W), without furniture.

    Neighbours are connected if their depths differ by less than `step`, metres. Components with a visible
    area below `min_area_m2`, and those that are still larger than a person after furniture is cut off, are
    left out. If no candidate is left of a component, what surely is a body is kept instead.
    """
    segmentation = view.settings.segmentation
    labels = label_parts(view.depth, free, step, segmentation.step_m, view.noise, view.intrinsics.fx)
    areas, windows = measure_components(labels, view.depth, view.intrinsics.fx, view.intrinsics.fy)
    parts, candidate_limits = list[Part](), view.settings.candidates
    possible = (areas >= min_area_m2) & (areas <= candidate_limits.max_joined_m2)
    for label in np.flatnonzero(possible).tolist():
        left, top, right, bottom = windows[label].tolist()
        window = slice(top, bottom), slice(left, right)
        mask = labels[window] == label
        part = part_of(view, mask, window, mask)
        if areas[label] < segmentation.min_person_m2:
            parts.append(part)
            continue
        left_over = without_large(view, cut_off_furniture(view, part))
        if body_pixels is not None and not any(candidate_of(view, smaller) for smaller in left_over):
            bodies = without_large(view, bodies_of(view, part, body_pixels))
            left_over = bodies if any(candidate_of(view, body) for body in bodies) else left_over
        parts += left_over
    return parts


def without_large(view: SceneView, parts: Sequence[Part]) -> list[Part]:
    """The parts that are not larger than a person."""
    max_area_m2 = view.settings.candidates.max_person_m2
    return [part for part in parts if area_of(view, part.points) <= max_area_m2]


def bodies_of(view: SceneView, part: Part, body_pixels: BodyPixels) -> list[Part]:
    """The parts of a component that surely are bodies. Gaps within a body are narrower than the reach."""
    whole = np.zeros(view.depth.shape, dtype=np.bool_)
    part.mark(whole)
    likely, reach_m = body_pixels(view, whole)[part.window], reach_of(view.settings.segmentation)
    mask = likely > LIKELY
    depth = np.where(mask, view.depth[part.window], np.float32(0.0))
    labels = label_parts(depth, mask, reach_m, reach_m, view.noise, view.intrinsics.fx)
    areas, _ = measure_components(labels, depth, view.intrinsics.fx, view.intrinsics.fy)
    large = np.flatnonzero(areas >= view.settings.segmentation.min_person_m2).tolist()
    sure = [label for label in large if np.mean(likely[labels == label]) > SURE]
    return [part_of(view, labels == label, part.window, part.uncut) for label in sure]


def area_of(view: SceneView, points: Array) -> float:
    """The area across the line of sight, square metres, of pixels with these points (P, 3)."""
    return float(np.sum(points[:, 2] ** 2)) / (view.intrinsics.fx * view.intrinsics.fy)


def part_of(view: SceneView, mask: Mask, window: tuple[slice, slice], uncut: Mask) -> Part:
    """The component with these pixels (H, W) of a window."""
    points = points_of(view.depth[window], intrinsics_of(view, window), mask)
    level = points @ view.planes.level.T
    y_range = float(level[:, 1].min()), float(level[:, 1].max())
    sampled_points = level[:: 1 + len(level) // view.settings.candidates.flat_points]
    length = float(extents(sampled_points, view.settings.planes.outlier_percent).max())
    return Part(window, mask, uncut, points, np.median(level, axis=0), y_range, length)


def intrinsics_of(view: SceneView, window: tuple[slice, slice]) -> Intrinsics:
    """The intrinsics of a window."""
    rows, columns = window
    width, height = columns.stop - columns.start, rows.stop - rows.start
    return view.intrinsics.crop(columns.start, rows.start, width, height)


def cut_off_furniture(view: SceneView, part: Part) -> list[Part]:
    """What remains of a component, in parts, once flat furniture is cut off.

    A flat patch is taken for furniture touching a person if what remains is as long as the whole component,
    or at least a metre long. Small parts are dropped. If no remaining part is that long, the patch may be a
    seat that the person is sitting on. If that cannot be cut off either, the component is kept whole, or
    dropped if most of it is flat.
    """
    depth, segmentation = view.depth[part.window], view.settings.segmentation
    candidate_limits = view.settings.candidates
    flat = find_flat_part(depth, part.mask, intrinsics_of(view, part.window), view.noise, view.settings)
    remaining_parts = list[Part]()
    if flat.patch_areas.max() >= segmentation.min_person_m2:
        curved = part.mask & ~flat.grow(flat.patch_areas >= candidate_limits.min_part_m2)
        step_m = segmentation.step_m
        labels = label_parts(depth, curved, step_m, step_m, view.noise, view.intrinsics.fx)
        areas, _ = measure_components(labels, depth, view.intrinsics.fx, view.intrinsics.fy)
        large = np.flatnonzero(areas >= segmentation.min_person_m2).tolist()
        remaining_parts = [part_of(view, labels == label, part.window, part.uncut) for label in large]
    longest = max((rest.length for rest in remaining_parts), default=0.0)
    if longest >= min(1.0, part.length):  # as long as the whole, or one metre
        return [smaller for rest in remaining_parts for smaller in cut_off_furniture(view, rest)]
    without_seat = part.mask & ~flat.grow(find_seat(view, part, flat))
    if 0 < np.count_nonzero(without_seat) < len(part.points):
        rest = part_of(view, without_seat, part.window, part.uncut)
        if rest.height >= part.height - segmentation.cell_m:
            kept = cut_off_furniture(view, rest)
            if any(candidate_of(view, smaller) for smaller in kept):
                return kept
    return [] if flat.share > candidate_limits.max_flat_share else [part]


def has_flat_side(view: SceneView, part: Part) -> bool:
    """Whether a component, before furniture was cut off, has a flat side, as furniture does."""
    camera = intrinsics_of(view, part.window)
    flat = find_flat_part(view.depth[part.window], part.uncut, camera, view.noise, view.settings)
    return bool(flat.patch_areas.max() >= MIN_FLAT_SIDE_M2)


def find_seat(view: SceneView, part: Part, flat: FlatPart) -> Mask:
    """The flat patches (H, W) of a component that reach down to the floor and are wider than a leg.

    A leg is assumed to be 9 cm wide per metre of the component's height.
    """
    segmentation = view.settings.segmentation
    patches = flat.patch_areas >= view.settings.candidates.min_part_m2
    floor = view.planes.above(part.points) < segmentation.cell_m
    if not view.planes.has_floor or not floor.any():
        return np.zeros_like(patches)
    depth, step_m = view.depth[part.window], segmentation.step_m
    labels = label_parts(depth, patches, step_m, step_m, view.noise, view.intrinsics.fx)
    low = labels[part.mask][floor]
    # `flat.size` is the square root of `min_part_m2` in pixels: 9 cm by default
    wide = labels[minimum_filter(patches, max(1, int(flat.size * part.height)), mode="constant")]
    return np.asarray(patches & np.isin(labels, np.intersect1d(low, wide)))


def join_parts(view: SceneView, person: Candidate, parts: Sequence[Part]) -> Candidate:
    """Join the candidate with parts at the same place: above it, below it, or behind something nearer.

    A head, a trunk and legs are such parts if a shoulder or a forearm hides the connection between them.
    Parts that may be two people are not joined.
    """
    own, candidate_limits = person.part, view.settings.candidates
    mask, joined = person.mask.copy(), [own]
    (upper, lower), half = own.y_range, 0.5 * candidate_limits.max_length_m
    for part in parts:
        top, bottom = part.y_range
        offset = own.middle - part.middle
        ends = min(upper, top), max(lower, bottom)
        far = (
            np.linalg.norm(offset[[0, 2]]) >= candidate_limits.same_spot_m
            or ends[1] - ends[0] >= candidate_limits.max_length_m
        )
        if far or (mask[part.window] & part.mask).any():
            continue
        smaller, larger = sorted((own.height, part.height))
        shared = min(lower, bottom) - max(upper, top)
        adjoins = -view.settings.segmentation.near_m < shared < 0.5 * smaller
        adjoins = adjoins and (smaller < candidate_limits.min_length_m or larger < half)
        if adjoins or has_occluder_between(view, joined, part):
            part.mark(mask)
            joined, (upper, lower) = [*joined, part], ends
    return replace(person, mask=mask, points=np.concatenate([part.points for part in joined]))


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
    """Whether a part touches a person in the image, with a depth step no larger than that of a limb.

    mask: (H, W) the person's pixels. around: the same, dilated.
    """
    outline = part.mask & around[part.window]
    if not outline.any():
        return False
    edge = np.zeros_like(mask)
    edge[part.window] = outline
    step = np.median(view.depth[edge]) - np.median(view.depth[mask & dilated(edge)])
    return bool(abs(step) < view.settings.candidates.max_limb_step_m)


def has_moved(view: SceneView, person: Candidate) -> bool:
    """Whether a part of a candidate has moved lately; its outline, where depth flickers, does not count."""
    permanence = view.permanence((0, 0, view.depth.shape[1], view.depth.shape[0]))
    if permanence is None:
        return False
    candidate_limits = view.settings.candidates
    moved = binary_erosion(person.widest & (permanence < candidate_limits.moved_permanence), np.ones((3, 3)))
    return area_of(view, points_of(view.depth, view.intrinsics, moved)) >= candidate_limits.min_moved_m2


def dilated(mask: Mask) -> Mask:
    """The mask (H, W), which must not be empty, dilated by two pixels."""
    (top, bottom), (left, right) = (np.flatnonzero(mask.any(axis=a))[[0, -1]].tolist() for a in (1, 0))
    box = slice(max(top - 2, 0), bottom + 3), slice(max(left - 2, 0), right + 3)
    wide = np.zeros_like(mask)
    wide[box] = binary_dilation(mask[box], iterations=2)
    return wide


def has_occluder_between(view: SceneView, joined: Sequence[Part], part: Part) -> bool:
    """Whether something nearer is between the joined parts of a person and another part."""
    weights = [len(own.points) for own in joined]
    start = np.average([own.pixel for own in joined], axis=0, weights=weights)
    rows, columns = np.linspace(start, part.pixel, 64).round().astype(int).T
    mask = np.zeros(view.depth.shape, dtype=np.bool_)
    for shown in (*joined, part):
        shown.mark(mask)
    between = view.depth[rows, columns][~mask[rows, columns]]
    depths = np.concatenate([own.points[:, 2] for own in joined]), part.points[:, 2]
    nearest = min(float(np.percentile(depth, 5.0)) for depth in depths)
    return bool(np.any((between > 0.0) & (between < nearest)))


def candidate_of(view: SceneView, part: Part) -> Candidate | None:
    """The candidate of a part; None if it is too small, too short or too long.

    The score increases towards the middle of the image and with the height up to one metre.
    """
    points, candidate_limits = part.points, view.settings.candidates
    area_m2 = area_of(view, points)
    if area_m2 < view.settings.segmentation.min_person_m2:
        return None
    sampled_points = points[:: 1 + len(points) // candidate_limits.flat_points]
    outliers = view.settings.planes.outlier_percent
    across, height, away = extents(sampled_points @ view.planes.level.T, outliers).tolist()
    if not candidate_limits.min_length_m <= max(across, height, away) <= candidate_limits.max_length_m:
        return None
    x, y, z = points.mean(axis=0)
    centred = np.exp(-2.0 * (x * x + y * y) / (z * z))
    score = float(centred * min(1.0, height) ** 2)
    description = f"{height:.2f} m high, {across:.2f} m wide, {away:.2f} m deep, {area_m2:.2f} m2 visible"
    mask = np.zeros(view.depth.shape, dtype=np.bool_)
    part.mark(mask)
    return Candidate(mask, points, part, score, description)
