"""Limbs that reach for what nothing explains (preset `default`).

A limb that is lost is seldom hidden: the camera sees it, and no part of the model is near what it sees. So
for each limb many ways to hold it are drawn, and those are kept that come near the points that the rest of
the body leaves unexplained. A limb's own points count as well: what is left behind is no gain.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.kinematics import link_transforms
from common.kinematics.arrays import contiguous
from common.kinematics.skinning import blend_each
from coordinator.filters.explaining import count_explained, mark_by_limb
from coordinator.filters.exploration import find_limbs

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

POINTS = 300  # observed points that are looked at
BODY_VERTICES = 800  # of the model, in its present pose
LIMB_VERTICES = 40  # of a limb in each way to hold it
DRAWS = 96  # ways to hold a limb that are tried first
BEST, VARIANTS = 8, 8  # of these, and how often each is varied
VARIATION = np.radians(20.0)  # one standard deviation
LEAST_GAIN = 0.01  # of the observed points


class Limb(NamedTuple):
    """A branch of the tree that ends in tips."""

    number: int  # among all groups of degrees of freedom that move on their own
    dofs: Indices  # (d,)
    low: Array  # (d,) of the values that are drawn
    high: Array
    chain: Indices  # (C,) degrees of freedom from the root to the tips; the limb's own are the last
    kinds: Indices  # (C,) as in the model, as are parents, axes and joints
    parents: Indices
    axes: Array
    joints: Array
    vertices: Array  # (LIMB_VERTICES, 3) at rest
    carriers: Indices  # (LIMB_VERTICES,) places in dofs


class Layout(NamedTuple):
    """What of a body is looked at."""

    some: tuple[Array, Indices, Array]  # vertices at rest (V, 3), their links and shares (V, K)
    limb_of: Indices  # (V,) of each of them
    groups: int  # limbs, and what they hang on
    limbs: tuple[Limb, ...]


class Reaches(NamedTuple):
    """Ways to hold a limb, each of a limb of its own."""

    dofs: list[Indices]
    angles: list[Array]


def find_reaches(
    model: BodyModel, pose: Array, observed: Array, count: int, rng: np.random.Generator
) -> Reaches | None:
    """Ways to hold limbs of pose (D,) so that they explain more of the observed points (P, 3).

    None where no limb could.
    """
    layout = layout_of(model)
    if not layout.limbs or not len(observed):
        return None
    points = observed[:: max(1, len(observed) // POINTS)]
    near = find_near(model, pose, points, layout)
    explained_by = near.sum(axis=0)  # (P,) limbs
    if np.count_nonzero(explained_by == 0) < max(3.0, LEAST_GAIN * len(points)):
        return None
    found: list[tuple[Limb, Array, Array]] = []
    for limb in layout.limbs:
        alone = explained_by == near[limb.number]  # what no other limb explains
        held, reached = try_ways(limb, pose, points[alone], rng)
        explained = np.count_nonzero(alone & near[limb.number])
        found.append((limb, held, np.maximum(0.0, reached - explained)))
    if not any(gain.any() for _, _, gain in found):
        return None
    weights = np.concatenate([gain for _, _, gain in found]) ** 2
    drawn = rng.choice(len(weights), size=count, p=weights / weights.sum())
    limb_at = np.repeat(np.arange(len(found)), [len(gain) for _, _, gain in found])
    angles = [way for _, held, _ in found for way in held]
    return Reaches([found[limb_at[k]][0].dofs for k in drawn], [angles[k] for k in drawn])


def find_near(model: BodyModel, pose: Array, points: Array, layout: Layout) -> Flags:
    """Which of the points (P, 3) are near each limb, (K, P)."""
    vertices, links, shares = layout.some
    posed = np.empty((1, len(vertices), 3))
    blend_each(vertices, links, shares, link_transforms(model, pose[None]), posed)
    near = np.empty((layout.groups, len(points)), dtype=np.bool_)
    mark_by_limb(contiguous(points.T), posed[0], layout.limb_of, near)
    return near


def try_ways(limb: Limb, pose: Array, points: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Ways (K, d) to hold a limb of pose (D,), and how many of the points (P, 3) each comes near."""
    held = rng.uniform(limb.low, limb.high, size=(DRAWS, len(limb.dofs)))
    reached = count_reached(limb, pose, held, points)
    best = np.argsort(-reached, kind="stable")[:BEST]
    varied = np.repeat(held[best], VARIANTS, axis=0)
    varied = np.clip(varied + VARIATION * rng.standard_normal(varied.shape), limb.low, limb.high)
    again = count_reached(limb, pose, varied, points)
    return np.concatenate([held[best], varied]), np.concatenate([reached[best], again])


def count_reached(limb: Limb, pose: Array, held: Array, points: Array) -> Array:
    """How many of the points (P, 3) the limb comes near, held in each of the ways (K, d)."""
    reached = np.empty(len(held))
    count_explained(
        limb.kinds,
        limb.parents,
        limb.axes,
        limb.joints,
        pose[limb.chain],
        held,
        limb.vertices,
        limb.carriers,
        points,
        reached,
    )
    return reached


@lru_cache(maxsize=16)
def layout_of(model: BodyModel) -> Layout:
    """What of the body is looked at: vertices all over it, and each limb that ends in tips."""
    groups = find_limbs(model)
    carrier = model.link_dofs[model.skin_links[:, 0]]  # of each vertex, -1 where nothing moves it
    group_of = np.zeros(len(model.kinds) + 1, dtype=np.int64)
    for number, dofs in enumerate(groups):
        group_of[dofs] = number
    some = np.arange(0, len(model.vertices), max(1, len(model.vertices) // BODY_VERTICES))
    limbs = [
        lay_out_limb(model, number, dofs, np.flatnonzero(np.isin(carrier, dofs)))
        for number, dofs in enumerate(groups)
        if is_limb(model, dofs) and np.isin(carrier, dofs).any()
    ]
    skin = model.vertices[some], model.skin_links[some], model.skin_weights[some]
    return Layout(skin, group_of[carrier[some]], len(groups), tuple(limbs))


def is_limb(model: BodyModel, dofs: Indices) -> bool:
    """Whether degrees of freedom hang on others, turn, and carry none but themselves."""
    carried = np.isin(model.parents, dofs) & ~np.isin(np.arange(len(model.parents)), dofs)
    return model.parents[dofs[0]] >= 0 and not carried.any() and bool(np.all(model.kinds[dofs] == ROTATION))


def lay_out_limb(model: BodyModel, number: int, dofs: Indices, vertices: Indices) -> Limb:
    """A limb with some of its vertices, evenly spread over their order."""
    some = vertices[np.linspace(0, len(vertices) - 1, min(LIMB_VERTICES, len(vertices))).astype(np.int64)]
    low, high = np.clip(model.limits[dofs], -np.pi, np.pi).T
    chain = np.concatenate([ancestors(model, dofs[0]), dofs])
    place = np.full(len(model.kinds) + 1, -1)  # in the chain; none for none, the last
    place[chain] = np.arange(len(chain))
    carriers = place[model.link_dofs[model.skin_links[some, 0]]] - (len(chain) - len(dofs))
    return Limb(
        number,
        dofs,
        low.copy(),
        high.copy(),
        chain,
        model.kinds[chain],
        place[model.parents[chain]],
        model.axes[chain],
        model.points[chain],
        model.vertices[some],
        carriers,
    )


def ancestors(model: BodyModel, dof: int) -> list[int]:
    """Degrees of freedom that carry another one, the root's first."""
    parent = int(model.parents[dof])
    return [] if parent < 0 else [*ancestors(model, parent), parent]
