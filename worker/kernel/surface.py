"""A body model packed for the kernel: neighbouring vertices together, fixed dtypes. Done once per model."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from common.compiling import numba
from worker.kernel.neighbourhoods import neighbourhoods

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LEAF = 8  # vertices that are ruled out together


class Skeleton(NamedTuple):
    """The part of a body model that moves."""

    kinds: NDArray[np.int64]  # (D,)
    parents: NDArray[np.int64]  # (D,)
    axes: NDArray[np.float64]  # (D, 3)
    points: NDArray[np.float64]  # (D, 3)
    limits: NDArray[np.float64]  # (D, 2)
    balls: NDArray[np.int64]  # (B,)
    link_dofs: NDArray[np.int64]  # (L,)
    single: NDArray[np.bool_]  # (D,) which of them are not part of a ball
    precisions: NDArray[np.float64]  # (D,) rest_spreads^-2, of the rest prior; 0 of what places the body


class Surface(NamedTuple):
    """The part that is seen, with vertices of a leaf, which are neighbours on one link, in a row."""

    vertices: NDArray[np.float64]  # (V, 3)
    normals: NDArray[np.float64]  # (V, 3) of length 1, or 0 where no triangle has an area
    leaves: NDArray[np.int64]  # (V,) ascending
    triangles: NDArray[np.uint32]  # (T, 3)
    skin_links: NDArray[np.uint32]  # (V, K)
    skin_weights: NDArray[np.float64]  # (V, K), 0 only after all others


_packed: WeakKeyDictionary[BodyModel, tuple[Skeleton, Surface]] = WeakKeyDictionary()


def pack_model(model: BodyModel) -> tuple[Skeleton, Surface]:
    """Skeleton and surface of a model; kept for as long as the model, which never changes."""
    if model not in _packed:
        _packed[model] = make_packed_model(model)
    return _packed[model]


def make_packed_model(model: BodyModel) -> tuple[Skeleton, Surface]:
    """Skeleton and surface of a model."""
    order, leaves = order_vertices(model)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    skin_links, skin_weights = weights_first(model.skin_links[order], model.skin_weights[order])
    root = np.array([name in ROOT_DOFS for name in model.dof_names])
    skeleton = Skeleton(
        model.kinds,
        model.parents,
        model.axes,
        model.points,
        model.limits,
        model.balls,
        model.link_dofs,
        model.single,
        np.where(root, 0.0, model.rest_spreads**-2.0),
    )
    surface = Surface(
        np.ascontiguousarray(model.vertices[order]),
        vertex_normals(model.vertices, model.triangles)[order],
        leaves,
        in_order(rank[model.triangles]),
        np.ascontiguousarray(skin_links, np.uint32),
        np.ascontiguousarray(skin_weights),
    )
    return skeleton, surface


def in_order(triangles: NDArray[np.int64]) -> NDArray[np.uint32]:
    """Triangles (T, 3) in the order of their first corners; small numbers are sorted in one go."""
    first = triangles[:, 0]
    small = first.max(initial=0) <= np.iinfo(np.uint16).max
    order = np.argsort(first.astype(np.uint16) if small else first, kind="stable")
    return triangles[order].astype(np.uint32)


def weights_first(
    links: NDArray[np.int64], weights: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Links and weights (V, K) of vertices, those without weight last, and no more than there must be."""
    some = weights > 0.0
    most = max(1, int(np.count_nonzero(some, axis=1).max(initial=1)))
    if not np.any(some[:, 1:] & ~some[:, :-1]):  # as it is in most models
        return links[:, :most], weights[:, :most]
    order = np.argsort(~some, axis=1, kind="stable")[:, :most]
    return np.take_along_axis(links, order, axis=1), np.take_along_axis(weights, order, axis=1)


def order_vertices(model: BodyModel) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """An order (V,) of the vertices in which those of a leaf stand together, and each place's leaf (V,)."""
    order: list[NDArray[np.int64]] = []
    leaves: list[NDArray[np.int64]] = []
    dominant = model.skin_links[:, 0]
    for link in np.unique(dominant):
        members = np.flatnonzero(dominant == link)
        order.append(members[neighbourhoods(model.vertices[members], LEAF, LEAF)])
        leaves.append(np.arange(len(members)) // LEAF + (leaves[-1][-1] + 1 if leaves else 0))
    return np.concatenate(order), np.concatenate(leaves)


@numba.njit(cache=True, nogil=True)
def vertex_normals(vertices: Array, triangles: Indices) -> Array:
    """Normals (V, 3) at rest, the mean of the triangles' around a vertex by their area."""
    around = np.zeros(vertices.shape)
    for corner in range(3):
        for t in range(len(triangles)):
            a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
            o = vertices[a]
            ux, uy, uz = vertices[b, 0] - o[0], vertices[b, 1] - o[1], vertices[b, 2] - o[2]
            vx, vy, vz = vertices[c, 0] - o[0], vertices[c, 1] - o[1], vertices[c, 2] - o[2]
            n = triangles[t, corner]
            around[n, 0] += uy * vz - uz * vy
            around[n, 1] += uz * vx - ux * vz
            around[n, 2] += ux * vy - uy * vx
    for v in range(len(around)):
        x, y, z = around[v]
        length = np.sqrt(x * x + y * y + z * z)
        if length > 0.0:
            around[v, 0], around[v, 1], around[v, 2] = x / length, y / length, z / length
    return around
