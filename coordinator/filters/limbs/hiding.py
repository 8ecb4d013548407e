"""Limbs that the frame does not show, held in other ways in which it would not show them (preset `default`).

Of a limb behind the body nothing is known but that it is hidden. Hypotheses that all hold it in one way
would say that it is known, and none would be near when it comes out elsewhere. So ways to hold it are drawn
from all that it can do, and those are kept in which what is seen would hide it as well.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.kinematics import link_transforms
from common.kinematics.chain import blend_each
from coordinator.filters.limbs.layout import LEAST, Flags, Indices, Limb, LimbView, Ways, draw_ways

Array = NDArray[np.float64]

DRAWS = 32  # ways to hold a limb that are tried
HIDDEN = 0.8  # of a limb's vertices, from which on it is hidden
CELL = 0.05  # metres, at the points' mean distance
BEHIND = -0.02  # metres from what is seen, from which on a vertex is hidden


class Cover(NamedTuple):
    """What is seen as the nearest distance (H, W) in each direction, infinite where nothing is."""

    nearest: Array
    scale: float  # cells for each unit of x / z and y / z
    corner: Indices  # (2,) column and row of the first cell


def find_hidden(
    model: BodyModel,
    pose: Array,
    view: LimbView | None,
    known: Flags,
    count: int,
    rng: np.random.Generator,
) -> Ways | None:
    """Ways to hold the limbs of pose (D,) that the frame does not show; None where it shows all of them.

    `known` (D,), or empty, are degrees of freedom that encoders show: limbs of these alone are not hidden.
    """
    if view is None:
        return None
    free = [limb for limb in view.layout.limbs if not len(known) or not known[limb.dofs].all()]
    unseen = [limb for limb in free if is_unseen(limb, view)]
    if not unseen:
        return None
    cover, found = cover_of(view.points), list[tuple[Limb, Array]]()
    for limb in unseen:
        held = np.vstack([pose[limb.dofs], draw_ways(limb, DRAWS, rng)])
        hidden = share_hidden(model, pose, limb, held, cover) >= HIDDEN
        if hidden[0] and hidden[1:].any():
            found.append((limb, held[1:][hidden[1:]]))
    if not found:
        return None
    drawn = [found[k] for k in rng.integers(len(found), size=count)]
    return Ways([limb.dofs for limb, _ in drawn], [held[rng.integers(len(held))] for _, held in drawn])


def is_unseen(limb: Limb, view: LimbView) -> bool:
    """Whether nothing that is seen is the limb's alone."""
    return bool(view.own[limb.number] < LEAST * len(view.points))


def cover_of(points: Array) -> Cover:
    """What points (P, 3) hide: each the cell that it is in and those around."""
    scale = float(points[:, 2].mean()) / CELL
    cells = np.empty((len(points), 2), dtype=np.int64)
    find_cells(points, scale, cells)
    corner = cells.min(axis=0) - 1
    width, height = cells.max(axis=0) - corner + 2
    nearest = np.full((height, width), np.inf)
    draw_nearest(points, cells - corner, nearest)
    return Cover(nearest, scale, corner)


def share_hidden(model: BodyModel, pose: Array, limb: Limb, held: Array, cover: Cover) -> Array:
    """Share (K,) of a limb's vertices that are behind what is seen, held in ways (K, d) of pose (D,)."""
    poses = np.repeat(pose[None], len(held), axis=0)
    poses[:, limb.dofs] = held
    vertices, links, shares = limb.skin
    posed, hidden = np.empty((len(held), len(vertices), 3)), np.empty(len(held))
    blend_each(vertices, links, shares, link_transforms(model, poses), posed)
    count_hidden(posed, cover.nearest, cover.scale, cover.corner, hidden)
    return hidden / len(vertices)


@numba.njit(cache=True, nogil=True)
def find_cells(points: Array, scale: float, cells: Indices) -> None:
    """Fill cells (P, 2) with column and row of points (P, 3) before the camera."""
    for p in range(len(points)):
        for a in range(2):
            cells[p, a] = int(np.floor(points[p, a] / points[p, 2] * scale))


@numba.njit(cache=True, nogil=True)
def draw_nearest(points: Array, cells: Indices, nearest: Array) -> None:
    """Draw points (P, 3) into nearest (H, W), each into its cell (P, 2), column and row, and those around."""
    for p in range(len(points)):
        column, row = cells[p]
        for v in range(max(0, row - 1), min(len(nearest), row + 2)):
            for u in range(max(0, column - 1), min(nearest.shape[1], column + 2)):
                nearest[v, u] = min(nearest[v, u], points[p, 2])


@numba.njit(cache=True, nogil=True)
def count_hidden(posed: Array, nearest: Array, scale: float, corner: Indices, hidden: Array) -> None:
    """Fill hidden (K,): how many vertices of (K, V, 3) are behind what is nearest (H, W) from a corner on."""
    hidden[:] = 0.0
    for k in range(len(posed)):
        for v in range(posed.shape[1]):
            x, y, z = posed[k, v]
            if z > CELL:
                column = int(np.floor(x / z * scale)) - corner[0]
                row = int(np.floor(y / z * scale)) - corner[1]
                if 0 <= row < nearest.shape[0] and 0 <= column < nearest.shape[1]:
                    hidden[k] += z > nearest[row, column] + BEHIND
