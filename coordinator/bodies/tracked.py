"""The bodies that can be tracked: people of any size, or one known body; with their active DOFs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from gepf.common.activation import activate
from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.coordinator.bodies.human.dofs import HUMAN_DOFS
from gepf.coordinator.bodies.human.keypoints import carry
from gepf.coordinator.bodies.human.shape_space import REFERENCE_STATURE, ShapeSpace

SIZES = 64  # bodies that are kept


class Size(NamedTuple):
    """Stature in metres, girth as a factor, and how far a small person has the proportions of an adult.

    `maturity` is 0 for the mean person of the stature and 1 for the proportions of an adult.
    """

    stature: float
    girth: float
    maturity: float = 0.0


USUAL_SIZE = Size(REFERENCE_STATURE, 1.0)  # if it is not known


@lru_cache(SIZES)
def coarsen(model: BodyModel, cell_m: float) -> BodyModel:
    """The same body with one vertex for each link and cell: the one nearest the mean of the vertices there.

    Cells are cubes of the rest pose with sides of `cell_m`. Triangles with two corners in one cell go.
    """
    cells = np.column_stack([model.skin_links[:, 0], np.floor(model.vertices / cell_m).astype(np.int64)])
    cells -= cells.min(axis=0)
    number = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, cell, count = np.unique(number, return_inverse=True, return_counts=True)
    means = np.zeros((len(count), 3))
    np.add.at(means, cell, model.vertices)
    distance = np.linalg.norm(model.vertices - (means / count[:, None])[cell], axis=1)
    order = np.lexsort((distance, cell))
    kept = order[np.cumsum(count) - count]  # (cells,) the vertex of each cell
    triangles = cell[model.triangles]
    apart = np.all(triangles != np.roll(triangles, 1, axis=1), axis=1)
    carriers, shares = model.keypoint_vertices, model.keypoint_shares
    if len(carriers):
        links = model.keypoint_links
        carriers, shares = carry(model.keypoint_points, links, model.vertices[kept], model.skin_links[kept])
    return replace(
        model,
        keypoint_vertices=carriers,
        keypoint_shares=shares,
        vertices=model.vertices[kept],
        shape_vertices=model.shape_vertices[:, kept],
        triangles=triangles[apart],
        skin_links=model.skin_links[kept],
        skin_weights=model.skin_weights[kept],
    )


def name_pose(model: BodyModel, values: Mapping[str, float]) -> Array:
    """Pose (D,) from values by name, zero if missing; InputError for an unknown name."""
    pose = np.zeros(len(model.dof_names))
    for name, value in values.items():
        pose[model.dof(name)] = value
    return pose


def pose_by_name(model: BodyModel, pose: Array) -> dict[str, float]:
    """Values of a pose (D,) by degree of freedom."""
    return dict(zip(model.dof_names, pose.tolist(), strict=True))


class Bodies:
    """People of any size, or one known body: a robot, an object, a person.

    Args:
        build: Full model from a size; all models have corresponding vertices.
        start_dofs: Degrees of freedom for detection.
        active: Tracked degrees of freedom.
        measures: The size, if it is known.
        dof_names: All degrees of freedom.
        people: Whether it is a person, who is detected in typical poses of people.
        content: Hash of a known body.
        space: The shapes that a body of unknown size may have.
    """

    def __init__(
        self,
        build: Callable[..., BodyModel],
        start_dofs: tuple[str, ...],
        active: tuple[str, ...],
        measures: Size | None = None,
        *,
        dof_names: tuple[str, ...] = HUMAN_DOFS,
        people: bool = True,
        content: str | None = None,
        space: ShapeSpace | None = None,
    ) -> None:
        self.full = lru_cache(SIZES)(build)
        self.for_start = lru_cache(SIZES)(self._for_start)
        self.start_dofs, self.active, self.measures, self.dof_names = start_dofs, active, measures, dof_names
        self.people, self.content, self.space = people, content, space

    def tracked(self, size: Size, values: Mapping[str, float]) -> tuple[BodyModel, Array]:
        """The tracked body, with other degrees of freedom held at `values`, and its pose (D,) there."""
        full = self.full(*size)
        return activate_at(full, self.active, name_pose(full, values))

    def flexible(self, size: Size, values: Mapping[str, float]) -> tuple[BodyModel, Array]:
        """As `tracked`, with shape coefficients as further degrees of freedom if the size is not known."""
        if self.space is None:
            return self.tracked(size, values)
        full = self.space.anybody
        held = name_pose(full, values)
        held[: full.shape_count] = self.space.coefficients(*size)
        return activate_at(full, (*full.dof_names[: full.shape_count], *self.active), held)

    def _for_start(self, *size: float) -> BodyModel:
        """The body with the degrees of freedom for detection."""
        full, start = self.full(*size), self._usual
        moved = [full.dof(name) for name in start.dof_names]
        return replace(
            start, vertices=full.vertices, points=full.points[moved], joint_points=full.joint_points
        )

    @cached_property
    def _usual(self) -> BodyModel:
        full = self.full(*(self.measures or USUAL_SIZE))
        return activate(full, self.start_dofs, np.zeros(len(full.dof_names)))


def activate_at(full: BodyModel, active: tuple[str, ...], pose: Array) -> tuple[BodyModel, Array]:
    """A body of which the active degrees of freedom move from a pose (D,) on, and its own pose there."""
    model = activate(full, active, pose)
    return model, pose[[full.dof(name) for name in model.dof_names]]


def one_body(
    model: BodyModel, start_dofs: tuple[str, ...], active: tuple[str, ...], measures: Size | None = None
) -> Bodies:
    """A known body with all its degrees of freedom: a robot, an object, or a person with known `measures`."""
    return Bodies(
        lambda *_: model,
        start_dofs,
        active,
        measures or Size(np.nan, np.nan),
        dof_names=model.dof_names,
        people=measures is not None,
        content=model.hash,
    )
