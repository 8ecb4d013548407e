"""The part of a body's surface that stands for a joint: that of the links that meet in it, near it."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import joint_positions

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NEAR = 0.12  # metres from the joint, one standard deviation of its region's weights
LEAST = 0.02  # weight, relative to the largest, from which on a vertex belongs to a region


class Regions(NamedTuple):
    """The regions of a body's joints: those of joint j are entries starts[j] to starts[j + 1]."""

    starts: Indices  # (J + 1,)
    vertices: Indices
    weights: Array


@lru_cache(maxsize=16)
def regions_of(model: BodyModel) -> Regions:
    """The region of each joint, by distance at rest."""
    at_rest = joint_positions(model, np.zeros((1, len(model.kinds))))[0]
    around = links_around(model)
    members = [region_of(model, around[link], at_rest[j]) for j, link in enumerate(model.joint_links)]
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in members)])
    vertices, weights = (np.concatenate(parts) for parts in zip(*members, strict=True))
    return Regions(starts.astype(np.int64), vertices, weights)


def region_of(model: BodyModel, around: NDArray[np.bool_], place: Array) -> tuple[Indices, Array]:
    """Vertices of some links (L,) with their weights about a place (3,); the nearest has the weight 1."""
    mine = np.flatnonzero(around[model.skin_links[:, 0]])
    if not len(mine):
        mine = np.arange(len(model.vertices))
    squared = np.sum((model.vertices[mine] - place) ** 2, axis=1)
    weights = np.exp(-0.5 * (squared - squared.min()) / NEAR**2)
    kept = weights >= LEAST
    return mine[kept], weights[kept]


def links_around(model: BodyModel) -> NDArray[np.bool_]:
    """Of each link (L, L): itself, what it hangs on and what hangs on it, over links without surface."""
    carried = np.unique(model.skin_links[:, 0])
    around = np.eye(len(model.link_names), dtype=np.bool_)
    for link in range(len(model.link_names)):
        above = carrier(model, link, carried)
        if above >= 0:
            around[link, above] = True
            around[above, link] |= link in carried
    return around


def carrier(model: BodyModel, link: int, carried: Indices) -> int:
    """The nearest link with surface that a link hangs on; -1 for none."""
    dof = int(model.link_dofs[link])
    while dof >= 0:
        dof = int(model.parents[dof])
        found = carried[model.link_dofs[carried] == dof]
        if len(found):
            return int(found[0])
    return -1
