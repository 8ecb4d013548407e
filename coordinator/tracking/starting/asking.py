"""Asks a frame about bodies that differ a little in size from the one that is tracked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from common.compiling import numba
from common.refinement import Refined
from common.settings import RefineSettings
from common.sizes import Body, Sized, Sizes, as_sizes
from coordinator.bodies.human.measures import REFERENCE_STATURE
from coordinator.bodies.tracked import BETWEEN, Bodies, size_of
from coordinator.tracking.starting.measuring import Measured, Shown
from coordinator.tracking.starting.start import Start
from coordinator.tracking.starting.uprightness import stance_of

Array = NDArray[np.float64]
Measures = tuple[float, float]  # stature in metres, and girth

STEP = 0.04  # of a measure, as a share
WITHOUT_GIRTH = 3  # variants: the body, one larger and one smaller
CELL = 5.0 / (18.0 * np.sqrt(3.0))
"""Mean square distance of points of a surface from the nearest of its vertices, of the area of each."""


@dataclass(frozen=True, slots=True, eq=False)
class Variants:
    """A body, one larger, smaller, thicker and thinner, each with its mean square grain, m^2."""

    about: Measures
    body: Sized
    grains: Array


def sizes_of(bodies: Bodies, values: Mapping[str, float]) -> Sizes:
    """All sizes of a body of which what does not move is held at these values."""
    usual, thick = (bodies.tracked(REFERENCE_STATURE, girth, values)[0] for girth in BETWEEN)
    return Sizes(usual, thick)


def vary(sizes: Sizes, about: Measures) -> Variants:
    """The body of these measures and those beside it."""
    stature, girth = about
    larger, smaller = float(np.exp(STEP)), float(np.exp(-STEP))
    beside = [(stature * larger, girth), (stature * smaller, girth)]
    beside += [(stature, girth * larger), (stature, girth * smaller)]
    varied = [size_of(*measures) for measures in (about, *beside)]
    grains = np.array([grain(sizes.body(size)) for size in varied])
    return Variants(about, Sized(sizes, np.array(varied)), grains)


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """Bodies of several sizes, all in one pose: their particles go to the workers with those of a frame."""

    bodies: Sized  # K of them
    costs: Array  # (K,) of log likelihood, of each body's grain
    poses: Array  # (K, D)

    def beside(self, model: BodyModel, poses: Array) -> tuple[Body, Array]:
        """Bodies and poses (N + K, D) of particles (N, D) of a model, which is a size too, and of these."""
        of_model = as_sizes(model, len(poses))
        assert isinstance(of_model, Sized)
        sizes = np.concatenate([of_model.sizes, self.bodies.sizes])
        return Sized(self.bodies.bodies, sizes, spare=len(self.poses)), np.concatenate([poses, self.poses])

    def read(self, model: BodyModel, refined: Refined) -> Shown | None:
        """What the frame says, by all bodies after their descent; `model` is one of any size.

        None where one of them was not answered in time, or did not come to rest.
        """
        fits = refined.log_likelihood + self.costs
        if not np.isfinite(fits).all():
            return None
        here, (up, down) = float(fits[0]), fits[1:].reshape(-1, 2).T
        slope, curvature = (up - down) / (2.0 * STEP), (2.0 * here - up - down) / STEP**2
        stance = stance_of(model, refined.poses[0])
        return Shown(slope, curvature, stance.weigh(here), bent=stance.bent)


class Asker:
    """Makes questions, and bodies of the sizes that come out.

    Args:
        bodies: People of any size.
    """

    def __init__(self, bodies: Bodies) -> None:
        self._bodies = bodies
        self._variants: Variants | None = None
        self._values: Mapping[str, float] | None = None  # of what does not move, in all sizes
        self._sizes: Sizes | None = None

    def prepare(self) -> None:
        """Make what the first question needs, so that no frame has to wait for it."""
        for girth in BETWEEN if self._bodies.people and self._bodies.measures is None else ():
            self._bodies.full(REFERENCE_STATURE, girth)

    def can_ask(self, start: Start) -> bool:
        """Whether the body comes in sizes, and is free to be placed anew for each."""
        in_sizes = self._bodies.people and self._bodies.measures is None
        return in_sizes and set(ROOT_DOFS) <= set(start.model.dof_names)

    def ask(self, start: Start, about: Measured, pose: Array, rules: RefineSettings) -> Question:
        """About a body of about what is known, in this pose (D,) before its descent."""
        variants = self._vary(start, about.about)
        asked = len(variants.grains) if about.asks_girth else WITHOUT_GIRTH
        bodies = replace(variants.body, sizes=variants.body.sizes[:asked])
        costs = 0.5 * variants.grains[:asked] / rules.likelihood_scale**2
        return Question(bodies, costs, np.repeat(pose[None], asked, axis=0))

    def resize(self, start: Start, stature: float, girth: float) -> Start:
        """The same start with a body of another size."""
        sizes, size = self._sizes_of(start), size_of(stature, girth)
        return replace(start, model=sizes.body(size), stature=stature, girth=girth)

    def _sizes_of(self, start: Start) -> Sizes:
        """All sizes of a body, made once for each pose of what does not move."""
        if self._sizes is None or self._values is not start.values:
            self._values, self._sizes = start.values, sizes_of(self._bodies, start.values)
        return self._sizes

    def _vary(self, start: Start, about: Measures) -> Variants:
        """The variants of a body, made once for each."""
        sizes = self._sizes_of(start)
        if self._variants is None or self._variants.about != about or self._variants.body.bodies is not sizes:
            self._variants = vary(sizes, about)
        return self._variants


def grain(model: BodyModel) -> float:
    """Mean square distance (m^2) of points on the surface from its nearest vertex.

    By as much a body of few vertices is dearer than a smaller one of as many, however well it fits.
    """
    return float(CELL * area(model.vertices, model.triangles) / len(model.vertices))


@numba.njit(cache=True, nogil=True)
def area(vertices: Array, triangles: NDArray[np.int64]) -> float:
    """Of a surface, square metres."""
    total = 0.0
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        o = vertices[a]
        ux, uy, uz = vertices[b, 0] - o[0], vertices[b, 1] - o[1], vertices[b, 2] - o[2]
        vx, vy, vz = vertices[c, 0] - o[0], vertices[c, 1] - o[1], vertices[c, 2] - o[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        total += 0.5 * np.sqrt(x * x + y * y + z * z)
    return total
