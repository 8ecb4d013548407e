"""Asks a frame about bodies that differ a little in size from the one that is tracked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from common.settings import RefineSettings
from coordinator.bodies.human.measures import REFERENCE_STATURE
from coordinator.bodies.tracked import Bodies, scaled
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.starting.measuring import Shown, uprightness, weigh_frame
from coordinator.tracking.starting.start import Start

Array = NDArray[np.float64]

STEP = 0.04  # of a measure, as a share
THICKER = 0.1  # than usual, of the second body from which those of all girths are made
BETWEEN = (1.0, 1.0 + THICKER)  # girths of these two
ROUNDS = 4  # of ICP for each body
CELL = 5.0 / (18.0 * np.sqrt(3.0))
"""Mean square distance of points of a surface from the nearest of its vertices, of the area of each."""


@dataclass(frozen=True, slots=True, eq=False)
class Variants:
    """The tracked body, one larger, smaller, thicker and thinner, each with its mean square grain, m^2."""

    start: Start
    bodies: tuple[BodyModel, ...]
    grains: Array


@dataclass(frozen=True, slots=True, eq=False)
class Sizes:
    """A person as tracked, in any size: the body is linear in girth, and all of it scales with stature."""

    values: Mapping[str, float]  # of what does not move
    usual: BodyModel  # of the reference's stature, and girth 1
    thick: BodyModel  # the same with girth 1 + THICKER

    def body(self, stature: float, girth: float) -> BodyModel:
        """The body of this stature (m) and girth."""
        share = (girth - 1.0) / THICKER

        def between(usual: Array, thick: Array) -> Array:
            moved: Array = usual + share * (thick - usual)
            return moved

        of_girth = replace(
            self.usual,
            vertices=between(self.usual.vertices, self.thick.vertices),
            points=between(self.usual.points, self.thick.points),
            joint_points=between(self.usual.joint_points, self.thick.joint_points),
        )
        return scaled(of_girth, stature / REFERENCE_STATURE)


def sizes_of(bodies: Bodies, values: Mapping[str, float]) -> Sizes:
    """All sizes of a body of which what does not move is held at these values."""
    usual, thick = (bodies.tracked(REFERENCE_STATURE, girth, values)[0] for girth in BETWEEN)
    return Sizes(values, usual, thick)


class Asker:
    """Asks the frame that was published last.

    Args:
        bodies: People of any size.
        refiner: Has the pose refined for each.
    """

    def __init__(self, bodies: Bodies, refiner: Refiner) -> None:
        self._bodies = bodies
        self._refiner = refiner
        self._variants: Variants | None = None
        self._sizes: Sizes | None = None

    def prepare(self) -> None:
        """Make what the first question needs, so that no frame has to wait for it."""
        for girth in BETWEEN if self._bodies.people and self._bodies.measures is None else ():
            self._bodies.full(REFERENCE_STATURE, girth)

    def can_ask(self, start: Start) -> bool:
        """Whether the body comes in sizes, and is free to be placed anew for each."""
        in_sizes = self._bodies.people and self._bodies.measures is None
        return in_sizes and set(ROOT_DOFS) <= set(start.model.dof_names)

    def ask(self, start: Start, pose: Array, rules: RefineSettings) -> Shown:
        """What the frame says, in which the body has about this pose (D,)."""
        variants, settings = self._vary(start), msgspec.structs.replace(rules, icp_iterations=ROUNDS)
        refined = [self._refiner.submit(body, pose[None], settings).result() for body in variants.bodies]
        fits = np.array([one.log_likelihood[0] for one in refined])
        fits += 0.5 * variants.grains / rules.likelihood_scale**2
        here, (up, down) = fits[0], fits[1:].reshape(2, 2).T
        weight = weigh_frame(uprightness(start.model, refined[0].poses[0]), here)
        return Shown((up - down) / (2.0 * STEP), (2.0 * here - up - down) / STEP**2, weight)

    def resize(self, start: Start, stature: float, girth: float) -> Start:
        """The same start with a body of another size."""
        model = self._sizes_of(start).body(stature, girth)
        return replace(start, model=model, stature=stature, girth=girth)

    def _sizes_of(self, start: Start) -> Sizes:
        """All sizes of a body, made once for each pose of what does not move."""
        if self._sizes is None or self._sizes.values is not start.values:
            self._sizes = sizes_of(self._bodies, start.values)
        return self._sizes

    def _vary(self, start: Start) -> Variants:
        """The variants of a body, made once for each."""
        if self._variants is None or self._variants.start is not start:
            larger, smaller = float(np.exp(STEP)), float(np.exp(-STEP))
            bodies = (
                start.model,
                scaled(start.model, larger),
                scaled(start.model, smaller),
                self._sizes_of(start).body(start.stature, start.girth * larger),
                self._sizes_of(start).body(start.stature, start.girth * smaller),
            )
            self._variants = Variants(start, bodies, np.array([grain(body) for body in bodies]))
        return self._variants


def grain(model: BodyModel) -> float:
    """Mean square distance (m^2) of points on the surface from its nearest vertex.

    By as much a body of few vertices is dearer than a smaller one of as many, however well it fits.
    """
    a, b, c = (model.vertices[model.triangles[:, corner]] for corner in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return float(CELL * area / len(model.vertices))
