"""A body model packed for the kernel, once per model: vertices ordered by neighbourhood, fixed dtypes.

Arrays that need not be exact have single precision, so that more of them stay in the cache of a core.
"""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask, Points
from gepf.common.body import BodyModel, vertex_normals
from gepf.common.compiling import numba
from gepf.worker.kernel.shape import fit_fields

LEAF = 8  # vertices that the closest-point search skips together


class Skeleton(NamedTuple):
    """The kinematic part of a body model."""

    kinds: Indices  # (D,)
    parents: Indices  # (D,)
    axes: Array  # (D, 3)
    points: Array  # (D, 3)
    limits: Array  # (D, 2)
    balls: Indices  # (B,)
    link_dofs: Indices  # (L,)
    single: Mask  # (D,) which of them are not part of a spherical joint
    shape_points: Array  # (S, D, 3) change of the points per unit of each shape coefficient
    shape_fields: Array  # (L, S, 3, 4), see `shape`


class Surface(NamedTuple):
    """The surface of a body model; successive vertices form leaves of neighbours on one link."""

    vertices: Array  # (V, 3)
    normals: Points  # (V, 3) of length 1
    radii: Points  # (V,) metres, of the discs around the vertices, see `terms.depth`
    leaves: Indices  # (V,) ascending
    triangles: NDArray[np.uint32]  # (T, 3)
    skin_links: NDArray[np.uint32]  # (V, K)
    skin_weights: Array  # (V, K)
    link_dofs: Indices  # (L,) as of the skeleton
    shape_vertices: Points  # (S, V, 3) change of the vertices per unit of each shape coefficient


_packed: WeakKeyDictionary[BodyModel, tuple[Skeleton, Surface]] = WeakKeyDictionary()


def pack_model(model: BodyModel) -> tuple[Skeleton, Surface]:
    """Skeleton and surface of a model, cached as long as the model exists."""
    if model not in _packed:
        _packed[model] = make_packed_model(model)
    return _packed[model]


def make_packed_model(model: BodyModel) -> tuple[Skeleton, Surface]:
    """Skeleton and surface of a model."""
    order, leaves = order_vertices(model)
    places = np.argsort(order)
    triangles = places[model.triangles]
    used = np.any(model.skin_weights > 0.0, axis=0)
    skeleton = Skeleton(
        model.kinds,
        model.parents,
        model.axes,
        model.points,
        model.limits,
        model.balls,
        model.link_dofs,
        model.single,
        model.shape_points,
        fit_fields(model),
    )
    surface = Surface(
        model.vertices[order],
        vertex_normals(model.vertices, model.triangles)[order].astype(np.float32),
        disc_radii(model)[order].astype(np.float32),
        leaves,
        triangles[np.argsort(triangles[:, 0], kind="stable")].astype(np.uint32),
        np.ascontiguousarray(model.skin_links[order][:, used], np.uint32),
        np.ascontiguousarray(model.skin_weights[order][:, used]),
        model.link_dofs,
        np.ascontiguousarray(model.shape_vertices[:, order], np.float32),
    )
    return skeleton, surface


def order_vertices(model: BodyModel) -> tuple[Indices, Indices]:
    """An order (V,) of the vertices by leaves, and the leaf (V,) at each place of this order."""
    order: list[Indices] = []
    leaves: list[Indices] = []
    dominant = model.skin_links[:, 0]
    for link in np.unique(dominant):
        members = np.flatnonzero(dominant == link)
        order.append(members[neighbourhoods(model.vertices[members], LEAF)])
        leaves.append(np.arange(len(members)) // LEAF + (leaves[-1][-1] + 1 if leaves else 0))
    return np.concatenate(order), np.concatenate(leaves)


def disc_radii(model: BodyModel) -> Array:
    """Radii (V,) in metres of discs around the vertices, each with a third of the area of its triangles."""
    sides = np.diff(model.vertices[model.triangles], axis=1)
    areas = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    shares = np.bincount(model.triangles.ravel(), np.repeat(areas / 3.0, 3), len(model.vertices))
    return np.sqrt(shares / np.pi)


@numba.njit(cache=True, nogil=True)
def neighbourhoods(points: Array, size: int) -> Indices:
    """An order (P,) of points (P, 3) in which groups of `size`, 2 `size`, ... successive points are compact.

    As in a k-d tree, points are divided recursively along the longest side of the bounding box, such that the
    size of the first part is a power of 2 times `size`.
    """
    order = np.arange(len(points))
    waiting = [(0, len(points))]
    while len(waiting) > 0:
        start, stop = waiting.pop()
        first = size
        while 2 * first < stop - start:
            first *= 2
        if first < stop - start:
            divide(points, order, start, stop, start + first, longest_side(points, order[start:stop]))
            waiting.append((start, start + first))
            waiting.append((start + first, stop))
    return order


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def longest_side(points: Array, some: Indices) -> int:
    """The axis with the largest extent of some of the points (P, 3)."""
    longest, axis = -np.inf, 0
    for a in range(3):
        low = high = points[some[0], a]
        for i in some:
            low, high = min(low, points[i, a]), max(high, points[i, a])
        if high - low > longest:
            longest, axis = high - low, a
    return axis


@numba.njit(cache=True, nogil=True)
def divide(points: Array, order: Indices, start: int, stop: int, middle: int, axis: int) -> None:
    """Rearrange order[start:stop] so that no point before `middle` exceeds one after it.

    Hoare's selection.
    """
    low, high = start, stop - 1
    while low < high:
        pivot = points[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while points[order[i], axis] < pivot:
                i += 1
            while points[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return
