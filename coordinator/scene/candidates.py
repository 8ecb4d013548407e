"""Candidates for people in a frame, before a body is known.

A candidate is a connected component of the foreground that has the extent and area of a person and, unlike
furniture, is not flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import find_objects

from common.camera import back_project, level_from_camera
from coordinator.scene.planes import FLAT_SHARE, Array, extents, share_on_plane, to_rays
from coordinator.scene.scene import FOREGROUND, PERSON_LENGTH_M, Mask, SceneView
from coordinator.scene.segmentation import label_parts

AREA_M2 = (0.1, 1.6)  # visible area of a person
LEAST_PART_M2, SAME_SPOT_M = 0.008, 0.35  # of a further part of a person, with an occluder between
SAMPLED = 800  # points for extents and planes


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A candidate for a person.

    mask: (H, W) its pixels. points: (P, 3) their points in the camera frame, metres. score: from 0 to 1.
    why: its measures as text.
    """

    mask: Mask
    points: Array
    score: float
    why: str


def candidates(view: SceneView, known: Mask | None = None) -> list[Candidate]:
    """Candidates for people, best first; pixels (H, W) of known people are excluded."""
    free = view.marks() == FOREGROUND
    if known is not None:
        free &= ~known
    labels = label_parts(view.depth, free, view.growth)
    pixel_areas = (view.depth**2 / (view.camera.fx * view.camera.fy)).ravel()
    areas = np.bincount(labels.ravel(), pixel_areas)
    areas[0] = 0.0  # label 0 is the rest
    large = np.flatnonzero((areas >= AREA_M2[0]) & (areas <= AREA_M2[1]))
    windows = find_objects(labels)
    found = [judge(view, labels == n, windows[n - 1], float(areas[n])) for n in large.tolist()]
    best = sorted((each for each in found if each is not None), key=lambda each: -each.score)
    parts = [labels == n for n in np.flatnonzero(areas >= LEAST_PART_M2).tolist()] if best else []
    return [join_hidden(view, each, parts) for each in best]


def join_hidden(view: SceneView, person: Candidate, parts: Sequence[Mask]) -> Candidate:
    """Join the candidate with parts (H, W) at the same place if something nearer is between them."""
    turn, mask = level_from_camera(view.planes.up).T, person.mask
    for part in parts:
        if (part & mask).any():
            continue
        points = back_project(view.depth, view.camera)[part]
        mine, other = (np.median(each @ turn, axis=0) for each in (person.points, points))
        tall = np.ptp(np.concatenate([person.points, points]) @ turn[:, 1])
        if np.linalg.norm((mine - other)[[0, 2]]) < SAME_SPOT_M and tall < PERSON_LENGTH_M[1]:
            ends = [np.argwhere(each).mean(axis=0) for each in (mask, part)]
            rows, columns = np.linspace(ends[0], ends[1], 64).round().astype(int).T
            between = view.depth[rows, columns][~(mask | part)[rows, columns]]
            nearest = min(float(np.percentile(each[:, 2], 5.0)) for each in (person.points, points))
            if np.any((between > 0.0) & (between < nearest)):
                mask = mask | part
    return replace(person, mask=mask, points=back_project(view.depth, view.camera)[mask])


def judge(view: SceneView, mask: Mask, window: tuple[slice, slice], area: float) -> Candidate | None:
    """The candidate of a part (H, W) with this area, square metres; None if it is too long or flat.

    The score increases towards the middle of the image and with the height up to one metre.
    """
    rows, columns = window
    camera = view.camera.crop(columns.start, rows.start, columns.stop, rows.stop)
    points = back_project(view.depth[window], camera)[mask[window]]
    some = points[:: 1 + len(points) // SAMPLED]
    across, height, away = extents(some @ level_from_camera(view.planes.up).T).tolist()
    flat = share_on_plane(to_rays(some, view.growth))
    if not PERSON_LENGTH_M[0] <= max(across, height, away) <= PERSON_LENGTH_M[1] or flat >= FLAT_SHARE:
        return None
    x, y, z = points.mean(axis=0)
    centred = np.exp(-2.0 * (x * x + y * y) / (z * z))
    score = float(centred * min(1.0, height) ** 2)
    why = (
        f"{height:.2f} m high, {across:.2f} m wide, {away:.2f} m deep, {area:.2f} m2 seen, "
        f"{100 * flat:.0f} % in one plane"
    )
    return Candidate(mask, points, score, why)
