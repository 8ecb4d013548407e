"""Robots and objects: rigid links of known shape, from a URDF file or a model in memory."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import MECHANISM, ROOT_DOFS, ROTATION, BodyModel
from gepf.common.packages import needs
from gepf.coordinator.bodies.angles import Angles, RevoluteJoint, level_turn, whole_body
from gepf.coordinator.bodies.family import Bodies, BodyFamily


class Mechanisms(BodyFamily):
    """Any single body of known shape. All that is known about its pose is the ranges of its joints."""

    name = MECHANISM
    nearest_m = 0.4

    def reads(self, path: Path) -> bool:
        """Always true: a file that no other family reads is taken for a URDF file."""
        del path
        return True

    def load(self, model: str) -> BodyModel:
        """The body of a URDF file."""
        with needs("robots", "a URDF file"):
            from gepf.coordinator.bodies.urdf import read_urdf

        return read_urdf(Path(model))

    def bodies(self, model: str, active: tuple[str, ...] | None, preset: str) -> Bodies:
        """The body of a URDF file; all its degrees of freedom move by default."""
        return self.given(self.load(model), active, preset)

    def draw_poses(self, model: BodyModel, count: int, rng: np.random.Generator) -> Array:
        """Poses (N, D) in any orientation, with joints anywhere within their ranges."""
        from gepf.coordinator.bodies.random_poses import draw_within_limits  # loads the compiler

        return draw_within_limits(model, count, rng)

    def angles(self, model: BodyModel, held: Mapping[str, float], up: Array | None) -> Angles:
        """The orientation of the base if it moves, and the values of the joints."""
        base = (whole_body("base"),) if set(ROOT_DOFS[3:]) & set(model.dof_names) else ()
        revolute = tuple(RevoluteJoint(name, name) for name in model.joints_of(ROTATION))
        return Angles(model.dof_names, base, revolute, held, level_turn(up))


MECHANISMS = Mechanisms()
