"""Finds a body in a frame, in any pose and turned in any way.

Poses of a library that look like what is observed are refined in stages: all of them a little on few points,
the best that differ in earnest on all points, the best of these on bodies of other sizes, and those that are
left by a few rounds of the filter itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.camera import back_project
from common.frame import SubjectFrame
from common.settings import RefineSettings
from coordinator.bodies.human.measures import REFERENCE_STATURE
from coordinator.bodies.tracked import Bodies
from coordinator.scene.room.planes import Planes
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.search.candidates import Alike, join, most_alike
from coordinator.tracking.search.facing import both_ways, turned_round
from coordinator.tracking.search.library import Library, any_library, people_library
from coordinator.tracking.search.recall import recall
from coordinator.tracking.search.settling import settle
from coordinator.tracking.search.sizes import (
    ANY,
    GIRTH,
    GIRTHS,
    Size,
    taller_and_shorter,
    thinner_and_thicker,
    vary,
)
from coordinator.tracking.search.stages import Standing, descend, rounds, thin

Array = NDArray[np.float64]

UPRIGHT = 0.0
WAYS_UP = (UPRIGHT, 0.5 * np.pi, np.pi, 1.5 * np.pi)
"""Turns of the picture, radians, in which a body is looked for: a camera may be held any way up."""


def ways_of(rotate_deg: int | None) -> tuple[float, ...]:
    """The turns, radians, for a camera of which the one is known, in degrees, or None."""
    return WAYS_UP if rotate_deg is None else (float(np.radians(rotate_deg)),)


def ways_from(planes: Planes, ways_up: Sequence[float]) -> tuple[float, ...]:
    """The same turns from where up is in the picture: who is upright comes first."""
    across, down, _ = planes.up
    if len(ways_up) == 1 or np.hypot(across, down) < STEEP:
        return tuple(ways_up)
    upright = float(np.arctan2(-across, -down))
    return tuple(upright + way for way in ways_up)


STEEP = 0.3  # cosine of the camera's pitch below which a picture has no upright
APART = 0.05  # metres in the mean joint: what is nearer is the same candidate
COMPARED = 4_000  # points, at the most


@dataclass(frozen=True, slots=True)
class Effort:
    """How many candidates each stage keeps, how many iterations of ICP they get, and on how many points."""

    candidates: int
    turned: int  # of every way up but the first
    first_iterations: int
    first_points: int
    survivors: int
    iterations: int
    finalists: int
    filter_rounds: int


THOROUGH = Effort(200, 40, 3, 1_000, 24, 12, 4, 4)
"""For a body of which nothing is known."""

QUICK = Effort(50, 5, 3, 1_000, 8, 6, 3, 0)
"""For a body whose size is known, frame by frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Where a body may be, of one size: poses (M, D), the likeliest first, with their log likelihood (M,).

    `residual` (M,) is the mean distance of the observed points from the model, metres.
    """

    size: Size
    model: BodyModel
    poses: Array
    log_likelihood: Array
    residual: Array


class Search:
    """Looks for a body in single frames.

    Args:
        bodies: Whoever may be there.
        refiner: Has candidates refined, here or elsewhere.
    """

    def __init__(self, bodies: Bodies, refiner: Refiner) -> None:
        self._bodies = bodies
        self._refiner = refiner
        self._known = None if bodies.measures is None else Size(*bodies.measures)
        self._usual = self._known or Size(REFERENCE_STATURE, GIRTH)
        self._library = library_of(bodies, self._usual)
        self._names = bodies.for_start(*self._usual).joint_names

    def prepare(self) -> None:
        """Make the bodies that candidates are tried on."""
        for girth in GIRTHS if self._known is None else ():
            self._bodies.full(REFERENCE_STATURE, girth)
            self._bodies.for_start(REFERENCE_STATURE, girth)

    def find(
        self,
        subject: SubjectFrame,
        settings: RefineSettings,
        effort: Effort,
        size: Size | None = None,
        ways_up: Sequence[float] = WAYS_UP,
        last: Array | None = None,
    ) -> Found:
        """The poses that explain a frame best, of a body of this size or, for None, of any.

        Most candidates are for the first of the ways up. Others are in the pose in which the body was seen
        `last` (D,), moved and turned. Who faces the other way is tried to the end.
        """
        size = size or self._known
        sizes = [size] if size else list(ANY)
        points = observed_points(subject)
        alike = self._guess(points, sizes, effort, ways_up)
        if last is not None:
            alike = join([alike, recall(self._bodies.for_start(*sizes[0]), last, points)])
        self._refiner.publish(thin(subject, effort.first_points))
        first = rounds(settings, effort.first_iterations)
        standing = self._descend(sizes, alike.poses, alike.sizes, first)
        standing = both_ways(standing, self._names, effort.survivors, APART)
        self._refiner.publish(subject)
        then = rounds(settings, effort.iterations)
        standing = self._descend(sizes, standing.poses, standing.sizes, then)
        standing = both_ways(standing, self._names, effort.finalists, APART)
        if size is None:
            sizes, standing = self._resize(sizes, standing, then, effort.finalists)
        return self._settle(subject, sizes[standing.sizes[0]], standing, settings, effort.filter_rounds)

    def _guess(self, points: Array, sizes: Sequence[Size], effort: Effort, ways_up: Sequence[float]) -> Alike:
        """Candidates from the library, in all ways up."""
        few = points[:: -(-len(points) // COMPARED)]
        factors = [size.stature / self._usual.stature if self._bodies.people else 1.0 for size in sizes]
        counts = [effort.candidates, *(effort.turned for _ in ways_up[1:])]
        ways = [way for way in zip(ways_up, counts, strict=True) if way[1]]
        return join([most_alike(few, self._library, factors, *way) for way in ways])

    def _resize(
        self, sizes: list[Size], standing: Standing, settings: RefineSettings, count: int
    ) -> tuple[list[Size], Standing]:
        """The candidates on bodies somewhat smaller and larger, and then thinner and thicker."""
        for step in (taller_and_shorter, thinner_and_thicker):
            sizes, place, of = vary([step(sizes[size]) for size in standing.sizes])
            standing = self._descend(sizes, standing.poses[of], place, settings)
            standing = both_ways(standing, self._names, count, APART)
        return sizes, standing

    def _settle(
        self, subject: SubjectFrame, size: Size, standing: Standing, settings: RefineSettings, count: int
    ) -> Found:
        """All that are left, on one body: those that face one way, and those that face the other."""
        model = self._bodies.for_start(*size)
        turned = turned_round(self._names, standing.joints, standing.joints[0])
        settled = [
            settle(self._refiner, subject, model, standing.take(np.flatnonzero(way)), settings, count)
            for way in (~turned, turned)
            if way.any()
        ]
        poses = np.concatenate([belief.poses for belief in settled])
        weights = np.concatenate([belief.log_weights for belief in settled])
        residual = np.concatenate([belief.residual for belief in settled])
        order = np.argsort(-weights, kind="stable")
        return Found(size, model, poses[order], weights[order], residual[order])

    def _descend(
        self, sizes: Sequence[Size], poses: Array, of: NDArray[np.int64], settings: RefineSettings
    ) -> Standing:
        return descend(self._refiner, [self._bodies.for_start(*size) for size in sizes], poses, of, settings)


@lru_cache(maxsize=4)
def library_of(bodies: Bodies, size: Size) -> Library:
    """The poses in which these bodies are looked for; made once for all trackers of a process."""
    usual = bodies.for_start(*size)
    return people_library(usual) if bodies.people else any_library(usual)


def observed_points(subject: SubjectFrame) -> Array:
    """The subject's points (P, 3) in the camera frame, metres."""
    depth = subject.frame.metres()
    points: Array = back_project(depth, subject.frame.intrinsics)[depth > 0]
    return points
