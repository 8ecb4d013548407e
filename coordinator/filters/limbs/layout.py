"""What of a body is looked at limb by limb: branches of the tree that end in tips, with some vertices."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, BodyModel
from common.kinematics import link_transforms
from common.kinematics.chain import blend_each, contiguous
from coordinator.filters.exploration import find_limbs
from coordinator.filters.limbs.explaining import compare_limbs, mark_by_limb, try_and_vary

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Skin = tuple[Array, Indices, Array]  # vertices at rest (V, 3), their links and shares (V, K)

BODY_VERTICES = 800  # of the model, in its present pose
LIMB_VERTICES = 40  # of a limb in each way to hold it
LEAST = 0.01  # of the observed points: so many are worth a way to hold a limb


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
    skin: Skin  # the same vertices

    def try_ways(
        self, pose: Array, points: Array, held: Array, variation: Array, best: int
    ) -> tuple[Array, Array]:
        """Ways (K, d) to hold the limb of pose (D,), and how many of the points (P, 3) each comes near.

        Those of held (N, d) that are best, and each of them varied by so many rows of variation in turn.
        """
        ways = np.empty((best + len(variation), len(self.dofs)))
        reached = np.empty(len(ways))
        try_and_vary(
            self.kinds,
            self.parents,
            self.axes,
            self.joints,
            pose[self.chain],
            self.low,
            self.high,
            held,
            variation,
            self.vertices,
            self.carriers,
            points,
            ways,
            reached,
        )
        return ways, reached


class Layout(NamedTuple):
    """What of a body is looked at."""

    some: Skin
    limb_of: Indices  # (V,) of each of them
    groups: int  # limbs, and what they hang on
    limbs: tuple[Limb, ...]


class LimbView(NamedTuple):
    """What a frame shows near the limbs of a pose."""

    layout: Layout
    points: Array  # (P, 3) observed
    alone: Flags  # (K, P) whether a point is near no other limb, nor near what limbs hang on but for that
    own: Indices  # (K,) points that a limb alone is near
    unexplained: int  # points that none is near


def draw_ways(limb: Limb, count: int, rng: np.random.Generator) -> Array:
    """Ways (count, d) to hold a limb, drawn from all that it can do."""
    return limb.low + (limb.high - limb.low) * rng.random((count, len(limb.dofs)))


class Ways(NamedTuple):
    """Ways to hold a limb, each of a limb of its own."""

    dofs: list[Indices]
    angles: list[Array]


def view_limbs(model: BodyModel, pose: Array, points: Array) -> LimbView | None:
    """What of observed points (P, 3) is near the limbs of pose (D,); None without a point or a limb."""
    layout = layout_of(model)
    if not layout.limbs or not len(points):
        return None
    vertices, links, shares = layout.some
    posed = np.empty((1, len(vertices), 3))
    blend_each(vertices, links, shares, link_transforms(model, pose[None]), posed)
    near, alone = np.empty((2, layout.groups, len(points)), dtype=np.bool_)
    own = np.empty(layout.groups, dtype=np.int64)
    mark_by_limb(contiguous(points.T), posed[0], layout.limb_of, near)
    return LimbView(layout, points, alone, own, compare_limbs(near, alone, own))


@lru_cache(maxsize=16)
def layout_of(model: BodyModel) -> Layout:
    """What of the body is looked at: vertices all over it, and each limb that ends in tips."""
    groups = find_limbs(model)
    carrier = model.link_dofs[model.skin_links[:, 0]]  # of each vertex, -1 where nothing moves it
    group_of = np.zeros(len(model.kinds) + 1, dtype=np.int64)
    for number, dofs in enumerate(groups):
        group_of[dofs] = number
    some = np.arange(0, len(model.vertices), max(1, len(model.vertices) // BODY_VERTICES))
    carried_by = group_of[carrier]
    limbs = [
        lay_out_limb(model, number, dofs, np.flatnonzero(carried_by == number))
        for number, dofs in enumerate(groups)
        if is_limb(model, dofs) and np.any(carried_by == number)
    ]
    for limb in limbs[:1]:
        load_counting(limb)
    skin = model.vertices[some], model.skin_links[some], model.skin_weights[some]
    return Layout(skin, carried_by[some], len(groups), tuple(limbs))


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
        (model.vertices[some], model.skin_links[some], model.skin_weights[some]),
    )


def load_counting(limb: Limb) -> None:
    """Read the compiled code that tries ways, for which the first frame with a lost limb would wait."""
    way = np.zeros((1, len(limb.dofs)))
    limb.try_ways(np.zeros(limb.chain.max() + 1), np.empty((0, 3)), way, way, 1)


def ancestors(model: BodyModel, dof: int) -> list[int]:
    """Degrees of freedom that carry another one, the root's first."""
    parent = int(model.parents[dof])
    return [] if parent < 0 else [*ancestors(model, parent), parent]
