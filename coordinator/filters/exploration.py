"""Proposals that explore a body limb by limb (preset `default`).

Twenty particles cannot fill 24 dimensions. But limbs move, and are lost, one by one. So fixed shares of
the particles follow the motion model exactly, or are data-driven: one limb of theirs is held so that it comes
near observed points that nothing explains. The others are spread by the covariance of their hypothesis.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.compiling import numba
from common.kinematics import link_transforms
from common.kinematics.chain import blend_each

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

PREDICTED_SHARE, DATA_DRIVEN_SHARE = 0.15, 0.35  # of the particles
VERTICES = 400  # of the body, that are compared with the observed points
NEAR_M = 0.08  # from a vertex, within which a point is explained
LEAST_UNEXPLAINED = 0.01  # share of the points
DRAWS = 80  # ways to hold a limb: twice as many take longer and explain no more


class Limb(NamedTuple):
    """A branch of the tree that ends in tips."""

    group: int  # among all groups of degrees of freedom that move on their own
    dofs: Indices  # (d,)
    low: Array  # (d,) of the values that are drawn
    high: Array


class Part(NamedTuple):
    """Some vertices (V, 3) of a body at rest that one group moves, with their skin (V, K)."""

    vertices: Array
    links: Indices
    weights: Array

    def pose(self, transforms: Array) -> Array:
        """The vertices (N, V, 3) by the links' transforms (N, L, 3, 4)."""
        posed = np.empty((len(transforms), *self.vertices.shape))
        blend_each(self.vertices, self.links, self.weights, transforms, posed)
        return posed


class Layout(NamedTuple):
    """What of a body is compared with the observed points: a part of each group, and the limbs."""

    parts: tuple[Part, ...]
    limbs: tuple[Limb, ...]


def choose_kinds(count: int, rng: np.random.Generator) -> tuple[Flags, Flags]:
    """Which particles (N,) get noise, and which are data-driven; the first follows motion alone."""
    places = rng.permutation(count) / count
    places[0] = 0.0
    data_driven = (places >= PREDICTED_SHARE) & (places < PREDICTED_SHARE + DATA_DRIVEN_SHARE)
    return places >= PREDICTED_SHARE + DATA_DRIVEN_SHARE, data_driven


def propose_limbs(
    model: BodyModel, pose: Array, points: Array, count: int, rng: np.random.Generator
) -> list[tuple[Indices, Array]]:
    """`count` proposals: degrees of freedom (d,) of a limb, and values (d,) that explain more points.

    For each limb of pose (D,) joint values are drawn uniformly within its limits. One of all draws is chosen
    with a probability proportional to the square of the number of points (P, 3) that it newly explains, less
    those that it explains no longer. Empty if hardly a point is unexplained, or no draw explains more.
    """
    layout, transforms = layout_of(model), link_transforms(model, pose[None])
    near = np.array([mark_near(points, part.pose(transforms))[0] for part in layout.parts])
    explained = near.sum(axis=0)
    if np.count_nonzero(explained == 0) < max(3.0, LEAST_UNEXPLAINED * len(points)):
        return []
    ways, gains = [], []
    for limb in layout.limbs:
        mine = near[limb.group]
        held = np.repeat(pose[None], DRAWS, axis=0)
        held[:, limb.dofs] = rng.uniform(limb.low, limb.high, size=(DRAWS, len(limb.dofs)))
        posed = layout.parts[limb.group].pose(link_transforms(model, held))
        reached = mark_near(points[explained == mine], posed).sum(axis=1)
        ways.append(held[:, limb.dofs])
        gains.append(np.maximum(0, reached - np.count_nonzero(mine & (explained == 1))))
    weights = np.concatenate(gains) ** 2 if gains else np.zeros(0)
    if not weights.any():
        return []
    drawn = rng.choice(len(weights), size=count, p=weights / weights.sum())
    return [(layout.limbs[k // DRAWS].dofs, ways[k // DRAWS][k % DRAWS]) for k in drawn]


def mark_near(points: Array, vertices: Array) -> Flags:
    """Which points (P, 3) are near each of several surfaces (K, V, 3), (K, P)."""
    near = np.empty((len(vertices), len(points)), dtype=np.bool_)
    fill_near(np.ascontiguousarray(points.T), vertices, near)
    return near


@numba.njit(cache=True, nogil=True)
def fill_near(points: Array, vertices: Array, near: Flags) -> None:
    """`mark_near` of points (3, P), which come last so that compiled code takes several at once."""
    near[:] = False
    for k in range(len(vertices)):
        for v in range(vertices.shape[1]):
            x, y, z = vertices[k, v]
            for p in range(points.shape[1]):
                dx, dy, dz = points[0, p] - x, points[1, p] - y, points[2, p] - z
                near[k, p] |= dx * dx + dy * dy + dz * dz <= NEAR_M * NEAR_M


def find_limbs(model: BodyModel) -> list[Indices]:
    """Degrees of freedom in groups that move on their own: each branch of the tree, and the trunk."""
    children = np.bincount(model.parents[model.parents >= 0], minlength=len(model.parents))
    limb_of = np.empty(len(model.parents), dtype=np.int64)
    for j, parent in enumerate(model.parents):
        branches = parent < 0 or children[parent] > 1
        limb_of[j] = j if branches else limb_of[parent]
    return [np.flatnonzero(limb_of == start) for start in np.unique(limb_of)]


@lru_cache(maxsize=16)
def layout_of(model: BodyModel) -> Layout:
    """What of a body is compared: vertices all over it, and limbs: groups that hang on others and turn."""
    groups = find_limbs(model)
    group_of_dof = np.zeros(len(model.kinds) + 1, dtype=np.int64)  # the last for what nothing moves
    for number, dofs in enumerate(groups):
        group_of_dof[dofs] = number
    some = np.arange(0, len(model.vertices), max(1, len(model.vertices) // VERTICES))
    group_of = group_of_dof[model.link_dofs[model.skin_links[some, 0]]]
    limbs = []
    for number, dofs in enumerate(groups):
        carries = np.any(np.isin(model.parents, dofs) & (group_of_dof[:-1] != number))
        turns = np.all(model.kinds[dofs] == ROTATION)
        if model.parents[dofs[0]] >= 0 and turns and not carries and np.any(group_of == number):
            limbs.append(Limb(number, dofs, *np.clip(model.limits[dofs], -np.pi, np.pi).T))
    mine = [some[group_of == number] for number in range(len(groups))]
    parts = (Part(model.vertices[v], model.skin_links[v], model.skin_weights[v]) for v in mine)
    return Layout(tuple(parts), tuple(limbs))
