"""Parts of a body: fewer vertices, active degrees of freedom; poses by name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS, BodyModel, unknown_dof
from gepf.common.errors import InputError
from gepf.coordinator.bodies.carried_points import carry

JOINTS = "joints"
"""Stands for all default degrees of freedom except the root, for a body with a fixed base."""

COARSE_BODIES = 64  # that are kept


@lru_cache(COARSE_BODIES)
def coarsen(model: BodyModel, cell_m: float) -> BodyModel:
    """The same body with one vertex for each link and cell: the one nearest the mean of the vertices there.

    Cells are cubes of the rest pose with sides of `cell_m`. Triangles with two corners in a cell are dropped.
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


def activate_at(full: BodyModel, active: tuple[str, ...], pose: Array) -> tuple[BodyModel, Array]:
    """The body with only the active degrees of freedom, others held at a pose (D,), and its own pose."""
    from gepf.common.activation import activate  # loads the compiler

    model = activate(full, active, pose)
    return model, pose[[full.dof(name) for name in model.dof_names]]


def choose_active(
    wanted: tuple[str, ...] | None, usual: tuple[str, ...], known: tuple[str, ...]
) -> tuple[str, ...]:
    """The active degrees of freedom, `usual` for None; InputError if one is not `known`."""
    if wanted is None:
        return usual
    chosen: list[str] = []
    for name in wanted:
        chosen.extend([n for n in usual if n not in ROOT_DOFS] if name == JOINTS else [name])
    for name in chosen:
        if name not in known:
            raise unknown_dof(name, known)
    if not chosen:
        raise InputError("this body has no joints; without --dof its position and orientation are tracked")
    return tuple(chosen)
