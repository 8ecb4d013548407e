"""Who may be a person in a frame, before anything is known of a body, and which of them is meant.

Parts of the picture that hang together, no part of floor, walls or background, with a person's extent and
area, and not flat as furniture is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects

from common.camera import back_project
from coordinator.scene.geometry import Array, Mask, label_parts, segment_plane
from coordinator.scene.noise import LEAST
from coordinator.scene.room import FOREGROUND, SceneView

LENGTH_M = (0.6, 2.5)  # of a person's greatest extent
AREA_M2 = (0.1, 1.6)  # that are seen of a person
USUAL_HEIGHT_M, HEIGHT_SPREAD = 1.0, 0.3  # of a person above which is usual, and of its logarithm below
USUALLY_FLAT, FLAT = 0.6, 0.8  # greatest share of a person in one plane, and what is furniture
ASIDE = 0.5  # tangent of the angle from the middle of the picture to where people stand less often
LEAST_PART_M2, SAME_SPOT_M = 0.008, 0.35  # of what else may be a part of a person, hidden in between
SPREAD_M = 0.005  # off a plane, the noise aside
EXTREMES = (1.0, 99.0)  # per cent of the points, between which an extent is taken
SAMPLED = 800  # points that extents and planes are taken from
RANSAC_ROUNDS = 100
MOVED = 0.2  # least share of pixels before a background that is known, of a person who moved
WAYS = ("best", "nearest", "largest", "moving")


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A person, perhaps.

    mask: (H, W) the pixels. points: (P, 3) the same in the camera frame, metres. score: from 0 to 1.
    why: its measures in words.
    """

    mask: Mask
    points: Array
    score: float
    why: str


@dataclass(frozen=True, slots=True)
class Person:
    """Which of several people is meant: one of WAYS, or a pixel at which the person is seen, column, row."""

    way: str = "best"
    pixel: tuple[int, int] | None = None

    def choose(self, view: SceneView, found: Sequence[Candidate]) -> list[Candidate]:
        """The candidates who may be meant, the likeliest first."""

        def moved(candidate: Candidate) -> float:
            return float(np.mean(view.background[candidate.mask] > 0.0))

        def pixels_off(candidate: Candidate) -> float:
            return float(np.linalg.norm(np.argwhere(candidate.mask) - at, axis=1).min())

        at = np.array((self.pixel or (0, 0))[::-1])
        order: dict[str, Callable[[Candidate], float]] = {
            "best": lambda each: -each.score,
            "nearest": lambda each: float(np.median(each.points[:, 2])),
            "largest": lambda each: -float(np.sum(each.points[:, 2] ** 2)),
            "moving": lambda each: -moved(each),
        }
        if self.way == "moving" and self.pixel is None:
            found = [each for each in found if moved(each) > MOVED]
        return sorted(found, key=order[self.way] if self.pixel is None else pixels_off)


def candidates(view: SceneView, known: Mask | None = None) -> list[Candidate]:
    """Who may be a person, best first; without pixels (H, W) of which it is known whose they are."""
    free = view.marks() == FOREGROUND
    if known is not None:
        free &= ~known
    labels = label_parts(view.depth, free, view.noise.growth)
    pixel_areas = (view.depth**2 / (view.camera.fx * view.camera.fy)).ravel()
    areas = np.bincount(labels.ravel(), pixel_areas)
    large = np.flatnonzero((areas >= AREA_M2[0]) & (areas <= AREA_M2[1]))
    windows = find_objects(labels)
    found = [judge(view, labels == n, windows[n - 1], float(areas[n])) for n in large.tolist() if n > 0]
    best = sorted((each for each in found if each is not None), key=lambda each: -each.score)
    small = [n for n in np.flatnonzero(areas >= LEAST_PART_M2).tolist() if n > 0]
    return [join_hidden(view, each, [labels == n for n in small]) for each in best]


def join_hidden(view: SceneView, person: Candidate, parts: Sequence[Mask]) -> Candidate:
    """The candidate with the parts (H, W) that stand on the same spot, where something nearer is between."""
    turn, mask = directions(view.up).T, person.mask
    for part in parts:
        if (part & mask).any():
            continue
        points = back_project(view.depth, view.camera)[part]
        mine, other = (np.median(each @ turn, axis=0) for each in (person.points, points))
        tall = np.ptp(np.concatenate([person.points, points]) @ turn[:, 1])
        if np.linalg.norm((mine - other)[[0, 2]]) < SAME_SPOT_M and tall < LENGTH_M[1]:
            ends = [np.argwhere(each).mean(axis=0) for each in (mask, part)]
            rows, columns = np.linspace(ends[0], ends[1], 64).round().astype(int).T
            between = view.depth[rows, columns][~(mask | part)[rows, columns]]
            nearest = min(float(np.percentile(each[:, 2], 5.0)) for each in (person.points, points))
            if np.any((between > 0.0) & (between < nearest)):
                mask = mask | part
    return replace(person, mask=mask, points=back_project(view.depth, view.camera)[mask])


def judge(view: SceneView, mask: Mask, window: tuple[slice, slice], area: float) -> Candidate | None:
    """A part of the frame (H, W) of this area, square metres; None if no person is so long or so flat."""
    rows, columns = window
    camera = view.camera.crop(columns.start, rows.start, columns.stop, rows.stop)
    inside = mask[window]
    points = back_project(view.depth[window], camera)[inside]
    some = points[:: 1 + len(points) // SAMPLED]
    low, high = np.percentile(some @ directions(view.up).T, EXTREMES, axis=0)
    across, height, away = high - low
    longest = max(across, height, away)
    flat = flat_share(view, some)
    if not LENGTH_M[0] <= longest <= LENGTH_M[1] or flat >= FLAT:
        return None
    x, y, z = points.mean(axis=0)
    centred = np.exp(-0.5 * ((x * x + y * y) / (z * z)) / ASIDE**2)
    upright = np.exp(-0.5 * (np.log(min(1.0, height / USUAL_HEIGHT_M)) / HEIGHT_SPREAD) ** 2)
    score = centred * upright * np.clip((FLAT - flat) / (FLAT - USUALLY_FLAT), 0.0, 1.0)
    why = (
        f"{height:.2f} m high, {across:.2f} m wide, {away:.2f} m deep, {area:.2f} m2 seen, "
        f"{100 * flat:.0f} % in one plane"
    )
    return Candidate(mask, points, float(score), why)


def directions(up: Array) -> NDArray[np.float64]:
    """Rows across, up, and away from the camera along the floor (3, 3)."""
    across = np.cross(up, np.array([0.0, 0.0, 1.0]))
    if np.linalg.norm(across) < NEARLY_PARALLEL:  # it looks straight down
        across = np.array([1.0, 0.0, 0.0])
    across = across / np.linalg.norm(across)
    return np.array([across, up, np.cross(across, up)])


NEARLY_PARALLEL = 0.1


def flat_share(view: SceneView, points: Array) -> float:
    """The share of points (P, 3) on the plane that holds the most of them."""
    z = float(np.median(points[:, 2]))
    spread = 2.0 * (LEAST + view.noise.growth * z * z) + SPREAD_M
    return len(segment_plane(points, spread, RANSAC_ROUNDS, seed=0)[1]) / len(points)
