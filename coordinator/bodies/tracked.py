"""The bodies that can be tracked: full models by measures, and the degrees of freedom that are active."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.activation import activate
from common.body import BodyModel
from coordinator.bodies.human.measures import REFERENCE_STATURE

Array = NDArray[np.float64]

THICKER = 0.1  # than the usual girth of 1: of the second body from which people of all girths are made
KEPT = 16  # bodies, of the sizes that were used last: two people may share one


def scaled(model: BodyModel, factor: float) -> BodyModel:
    """The same body, larger in all directions."""
    return replace(
        model,
        points=model.points * factor,
        vertices=model.vertices * factor,
        joint_points=model.joint_points * factor,
    )


@lru_cache(maxsize=KEPT)
def resized(slim: BodyModel, thick: BodyModel, share: float, scale: float) -> BodyModel:
    """A body at a share of the way from a slim one to the same one, thicker, and then larger by a factor."""

    def between(one: Array, other: Array) -> Array:
        return (one + share * (other - one)) * scale

    return replace(
        slim,
        points=between(slim.points, thick.points),
        vertices=between(slim.vertices, thick.vertices),
        joint_points=between(slim.joint_points, thick.joint_points),
    )


def name_pose(model: BodyModel, values: Mapping[str, float]) -> Array:
    """Pose (D,) from values by name, zero where there is none; InputError for an unknown name."""
    pose = np.zeros(len(model.dof_names))
    for name, value in values.items():
        pose[model.dof(name)] = value
    return pose


def pose_by_name(model: BodyModel, pose: Array) -> dict[str, float]:
    """Values of a pose (D,) by degree of freedom."""
    return dict(zip(model.dof_names, pose.tolist(), strict=True))


class Bodies:
    """People by stature (m) and girth, or whatever else comes in sizes.

    Args:
        build: Full model from stature and girth; all of them have the same vertices, moved.
        start_dofs: Degrees of freedom that a start is searched in.
        active: Those that are tracked.
        measures: Stature and girth, where they are known.
        dof_names: All degrees of freedom that there are; None to see by the body.
    """

    people = True
    """Whether it is a person, who is looked for in the postures of people."""

    content: str | None = None
    """Hash of a body that is known whole."""

    def __init__(
        self,
        build: Callable[[float, float], BodyModel],
        start_dofs: tuple[str, ...],
        active: tuple[str, ...],
        measures: tuple[float, float] | None = None,
        dof_names: tuple[str, ...] | None = None,
    ) -> None:
        self._dof_names = dof_names
        self._build = build
        self._full: dict[float, BodyModel] = {}
        self._started: dict[float, BodyModel] = {}
        self.start_dofs = start_dofs
        self.active = active
        self.measures = measures

    @property
    def dof_names(self) -> tuple[str, ...]:
        """All degrees of freedom, active or not."""
        return self._dof_names or self.full(REFERENCE_STATURE, 1.0).dof_names

    def full(self, stature: float, girth: float) -> BodyModel:
        """The body with all its degrees of freedom."""
        if girth not in self._full:
            self._full[girth] = self._build(REFERENCE_STATURE, girth)
        return scaled(self._full[girth], stature / REFERENCE_STATURE)

    def for_start(self, stature: float, girth: float) -> BodyModel:
        """The body with the degrees of freedom that a start is searched in."""
        if self.measures is not None:
            return self._starting(stature, girth)
        slim, thick = (self._starting(REFERENCE_STATURE, of) for of in (1.0, 1.0 + THICKER))
        if len(slim.vertices) != len(thick.vertices):
            return self._starting(stature, girth)
        return resized(slim, thick, (girth - 1.0) / THICKER, stature / REFERENCE_STATURE)

    def _starting(self, stature: float, girth: float) -> BodyModel:
        if girth not in self._started:
            full = self.full(REFERENCE_STATURE, girth)
            self._started[girth] = activate(full, self.start_dofs, np.zeros(len(full.dof_names)))
        started, scale = self._started[girth], stature / REFERENCE_STATURE
        return started if scale == 1.0 else scaled(started, scale)

    def tracked(self, stature: float, girth: float, values: Mapping[str, float]) -> tuple[BodyModel, Array]:
        """The body as it is tracked, what is not active held at `values`, and its pose (D,) there."""
        full = self.full(stature, girth)
        held = name_pose(full, values)
        model = activate(full, self.active, held)
        return model, held[[full.dof(name) for name in model.dof_names]]


class OneBody(Bodies):
    """A body that is known whole: a robot, an object, a person who was measured.

    Args:
        model: The body with all its degrees of freedom.
        start_dofs: Degrees of freedom that a start is searched in.
        active: Those that are tracked.
        measures: Stature and girth of a person; None for anything else.
    """

    def __init__(
        self,
        model: BodyModel,
        start_dofs: tuple[str, ...],
        active: tuple[str, ...],
        measures: tuple[float, float] | None = None,
    ) -> None:
        super().__init__(lambda *_: model, start_dofs, active, measures or (np.nan, np.nan))
        self._model = model
        self.people = measures is not None
        self.content = model.hash

    def full(self, stature: float, girth: float) -> BodyModel:  # noqa: ARG002 there is but one
        """The body with all its degrees of freedom."""
        return self._model

    def for_start(self, stature: float, girth: float) -> BodyModel:  # noqa: ARG002 there is but one
        """The body with the degrees of freedom that a start is searched in."""
        return self._starting(REFERENCE_STATURE, 1.0)
