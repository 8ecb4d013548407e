"""Selects a subset of a body's degrees of freedom; the others are held."""

from __future__ import annotations

from collections.abc import Container, Iterable

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.body import SHAPE, BodyModel, find_balls, surface_carriers
from gepf.common.kinematics import dof_transforms, joint_positions, pose_vertices, shaped


def activate(model: BodyModel, active: Iterable[str], held: Array) -> BodyModel:
    """The body with only the `active` degrees of freedom; the others are held at `held` (D,).

    The held pose, with active degrees of freedom at zero, becomes the rest pose of the result. So a pose of
    the result moves the body like the same values in the full model, except for skin at a bent held joint.
    An active shape coefficient changes the result as it changes the full model in the held pose. Active
    degrees of freedom keep the order of the model. Links that now move together are merged. Raises InputError
    for unknown names.
    """
    wanted = sorted({model.dof(name) for name in active})
    rest = np.array(held, dtype=np.float64)
    rest[wanted] = 0.0
    t_rest = dof_transforms(model, rest[None])[0]  # (D, 3, 4)
    axes = np.einsum("dij,dj->di", t_rest[wanted, :, :3], model.axes[wanted])
    shapes = [j for j in wanted if model.kinds[j] == SHAPE]
    points, vertices, joints = rest_geometry(model, rest, wanted)
    changed = [rest_geometry(model, rest + np.eye(len(rest))[j], wanted) for j in shapes]
    directions = [
        np.array([each[k] - zero for each in changed]).reshape(len(shapes), *zero.shape)
        for k, zero in enumerate((points, vertices, joints))
    ]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)

    place = {-1: -1} | {j: n for n, j in enumerate(wanted)}
    parents = np.array([place[nearest_in(model, place, int(model.parents[j]))] for j in wanted], np.int64)
    link_dofs = np.array([place[nearest_in(model, place, int(d))] for d in model.link_dofs], np.int64)
    moved, merged = np.unique(link_dofs, return_inverse=True)  # merged (L,): old link -> new link
    skin_links, skin_weights = merge_weights(merged[model.skin_links], model.skin_weights)
    kinds = model.kinds[wanted]
    return BodyModel(
        name=model.name,
        family=model.family,
        dof_names=tuple(model.dof_names[j] for j in wanted),
        kinds=kinds,
        parents=parents,
        axes=axes,
        points=points,
        limits=model.limits[wanted],
        rest_spreads=model.rest_spreads[wanted],
        balls=find_balls(kinds, parents, axes, points, surface_carriers(moved, skin_links, skin_weights)),
        link_names=tuple(model.link_names[int(np.argmax(merged == k))] for k in range(len(moved))),
        link_dofs=moved,
        vertices=vertices,
        triangles=model.triangles,
        skin_links=skin_links,
        skin_weights=skin_weights,
        joint_names=model.joint_names,
        joint_links=merged[model.joint_links],
        joint_points=joints,
        keypoint_links=merged[model.keypoint_links],
        keypoint_vertices=model.keypoint_vertices,
        keypoint_shares=model.keypoint_shares,
        shape_points=directions[0],
        shape_vertices=directions[1],
        shape_joint_points=directions[2],
    )


def rest_geometry(model: BodyModel, rest: Array, wanted: list[int]) -> tuple[Array, Array, Array]:
    """Points (W, 3) of the wanted DOFs, vertices (V, 3) and joints (J, 3), all in a held pose (D,)."""
    t_rest = dof_transforms(model, rest[None])[0][wanted]
    own = shaped(model.points, model.shape_points, rest[None])[0, wanted]
    points = np.einsum("dij,dj->di", t_rest[:, :, :3], own) + t_rest[:, :, 3]
    return points, pose_vertices(model, rest[None])[0], joint_positions(model, rest[None])[0]


def nearest_in(model: BodyModel, wanted: Container[int], dof: int) -> int:
    """The degree of freedom, or its nearest ancestor, that is one of the wanted; -1 if there is none."""
    while dof >= 0 and dof not in wanted:
        dof = int(model.parents[dof])
    return dof


def merge_weights(links: Indices, weights: Array) -> tuple[Indices, Array]:
    """Add the weights (V, K) of equal links (V, K); the dominant link is first."""
    merged = np.zeros_like(weights)
    for k in range(links.shape[1]):
        first = np.argmax(links == links[:, k : k + 1], axis=1)
        merged[np.arange(len(links)), first] += weights[:, k]
    order = np.argsort(-merged, axis=1, kind="stable")
    return np.take_along_axis(links, order, axis=1), np.take_along_axis(merged, order, axis=1)
