"""Limbs that reach for what nothing explains (preset `default`).

A limb that is lost is seldom hidden: the camera sees it, and no part of the model is near what it sees. So
for each limb many ways to hold it are drawn, and those are kept that come near the points that the rest of
the body leaves unexplained. A limb's own points count as well: what is left behind is no gain.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.kinematics import pose_vertices
from common.kinematics.chain import forward_kinematics
from coordinator.filters.exploration import find_limbs

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NEAR = 0.08  # metres from the surface within which a point is explained
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
    dofs: Indices
    low: Array  # of the angles that are drawn
    high: Array
    vertices: Array  # (LIMB_VERTICES, 3) at rest
    carriers: Indices  # (LIMB_VERTICES,) degrees of freedom


class Layout(NamedTuple):
    """What of a body is looked at."""

    some: Indices  # vertices
    limb_of: Indices  # of each of them
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
    layout = lay_out(model)
    if not layout.limbs or not len(observed):
        return None
    points = observed[:: max(1, len(observed) // POINTS)]
    vertices = pose_vertices(model, pose[None])[0][layout.some]
    squared = np.empty((len(points), int(layout.limb_of.max()) + 1))
    nearest_by_limb(points, vertices, layout.limb_of, squared)
    found: list[tuple[Limb, Array, Array]] = []
    for limb in layout.limbs:
        others = np.delete(squared, limb.number, axis=1).min(axis=1)
        alone = points[others > NEAR**2]
        explained = int(np.sum(squared[others > NEAR**2, limb.number] <= NEAR**2))
        if len(alone) - explained < max(3.0, LEAST_GAIN * len(points)):
            continue
        held, reached = try_ways(model, pose, limb, alone, rng)
        found.append((limb, held, np.maximum(0.0, reached - explained)))
    if not found or not any(gain.any() for _, _, gain in found):
        return None
    weights = np.concatenate([gain for _, _, gain in found]) ** 2
    drawn = rng.choice(len(weights), size=count, p=weights / weights.sum())
    limb_at = np.repeat(np.arange(len(found)), [len(gain) for _, _, gain in found])
    angles = [way for _, held, _ in found for way in held]
    return Reaches([found[limb_at[k]][0].dofs for k in drawn], [angles[k] for k in drawn])


def try_ways(
    model: BodyModel, pose: Array, limb: Limb, points: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Ways (K, d) to hold a limb, and how many of the points (P, 3) each comes near."""
    held = rng.uniform(limb.low, limb.high, size=(DRAWS, len(limb.dofs)))
    reached = count_reached(model, pose, limb, held, points)
    best = np.argsort(-reached, kind="stable")[:BEST]
    varied = np.repeat(held[best], VARIANTS, axis=0)
    varied = np.clip(varied + VARIATION * rng.standard_normal(varied.shape), limb.low, limb.high)
    again = count_reached(model, pose, limb, varied, points)
    return np.concatenate([held[best], varied]), np.concatenate([reached[best], again])


def count_reached(model: BodyModel, pose: Array, limb: Limb, held: Array, points: Array) -> Array:
    """How many of the points (P, 3) the limb comes near, held in each of the ways (K, d)."""
    reached = np.empty(len(held))
    count_each(
        model.kinds,
        model.parents,
        model.axes,
        model.points,
        pose.copy(),
        limb.dofs,
        held,
        limb.vertices,
        limb.carriers,
        points,
        reached,
    )
    return reached


@numba.njit(cache=True, nogil=True)
def count_each(  # noqa: PLR0913 a kernel
    kinds: Indices,
    parents: Indices,
    axes: Array,
    joints: Array,
    pose: Array,
    dofs: Indices,
    held: Array,
    vertices: Array,
    carriers: Indices,
    points: Array,
    reached: Array,
) -> None:
    """Fill reached (K,): of points (P, 3) that are near vertices (V, 3) of a limb, held in ways (K, d)."""
    transforms, posed = np.empty((len(kinds), 3, 4)), np.empty((len(vertices), 3))
    for k in range(len(held)):
        for i in range(len(dofs)):
            pose[dofs[i]] = held[k, i]
        forward_kinematics(kinds, parents, axes, joints, pose, transforms)
        for v in range(len(vertices)):
            t = transforms[carriers[v]]
            for a in range(3):
                posed[v, a] = (
                    t[a, 0] * vertices[v, 0] + t[a, 1] * vertices[v, 1] + t[a, 2] * vertices[v, 2] + t[a, 3]
                )
        reached[k] = 0.0
        for p in range(len(points)):
            for v in range(len(vertices)):
                x, y, z = posed[v, 0] - points[p, 0], posed[v, 1] - points[p, 1], posed[v, 2] - points[p, 2]
                if x * x + y * y + z * z <= NEAR * NEAR:
                    reached[k] += 1.0
                    break


@numba.njit(cache=True, nogil=True)
def nearest_by_limb(points: Array, vertices: Array, limb_of: Indices, squared: Array) -> None:
    """Fill squared (P, K): squared distance of points (P, 3) from the vertices (V, 3) of each limb."""
    squared[:] = np.inf
    for p in range(len(points)):
        for v in range(len(vertices)):
            x, y, z = (
                vertices[v, 0] - points[p, 0],
                vertices[v, 1] - points[p, 1],
                vertices[v, 2] - points[p, 2],
            )
            away = x * x + y * y + z * z
            squared[p, limb_of[v]] = min(squared[p, limb_of[v]], away)


@lru_cache(maxsize=16)
def lay_out(model: BodyModel) -> Layout:
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
    return Layout(some, group_of[carrier[some]], tuple(limbs))


def is_limb(model: BodyModel, dofs: Indices) -> bool:
    """Whether degrees of freedom hang on others, turn, and carry none but themselves."""
    carried = np.isin(model.parents, dofs) & ~np.isin(np.arange(len(model.parents)), dofs)
    return model.parents[dofs[0]] >= 0 and not carried.any() and bool(np.all(model.kinds[dofs] == ROTATION))


def lay_out_limb(model: BodyModel, number: int, dofs: Indices, vertices: Indices) -> Limb:
    """A limb with some of its vertices, evenly spread over their order."""
    some = vertices[np.linspace(0, len(vertices) - 1, min(LIMB_VERTICES, len(vertices))).astype(np.int64)]
    low, high = np.clip(model.limits[dofs], -np.pi, np.pi).T
    return Limb(
        number,
        dofs,
        low.copy(),
        high.copy(),
        model.vertices[some],
        model.link_dofs[model.skin_links[some, 0]],
    )
