"""Asks a frame about bodies that differ a little in size from the one that is tracked."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from common.settings import RefineSettings
from coordinator.bodies.tracked import Bodies, scaled
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.starting.measuring import Shown, uprightness, weigh_frame
from coordinator.tracking.starting.start import Start

Array = NDArray[np.float64]

STEP = 0.04  # of a measure, as a share
ROUNDS = 4  # of ICP for each body
CELL = 5.0 / (18.0 * np.sqrt(3.0))
"""Mean square distance of points of a surface from the nearest of its vertices, of the area of each."""


@dataclass(frozen=True, slots=True, eq=False)
class Variants:
    """The tracked body, one larger, smaller, thicker and thinner, each with its mean square grain, m^2."""

    start: Start
    bodies: tuple[BodyModel, ...]
    grains: Array


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

    def _vary(self, start: Start) -> Variants:
        """The variants of a body, made once for each."""
        if self._variants is None or self._variants.start is not start:
            larger, smaller = float(np.exp(STEP)), float(np.exp(-STEP))
            bodies = (
                start.model,
                scaled(start.model, larger),
                scaled(start.model, smaller),
                self._bodies.tracked(start.stature, start.girth * larger, start.values)[0],
                self._bodies.tracked(start.stature, start.girth * smaller, start.values)[0],
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
