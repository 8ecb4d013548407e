"""A body model packed for the kernel, once per model: vertices ordered by neighbourhood, fixed dtypes."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel, vertex_normals
from gepf.worker.kernel.neighbourhoods import neighbourhoods

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


class Surface(NamedTuple):
    """The surface of a body model; successive vertices form leaves of neighbours on one link."""

    vertices: Array  # (V, 3)
    normals: Array  # (V, 3) of length 1
    leaves: Indices  # (V,) ascending
    triangles: NDArray[np.uint32]  # (T, 3)
    skin_links: NDArray[np.uint32]  # (V, K)
    skin_weights: Array  # (V, K)


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
    )
    surface = Surface(
        model.vertices[order],
        vertex_normals(model.vertices, model.triangles)[order].astype(np.float64),
        leaves,
        triangles[np.argsort(triangles[:, 0], kind="stable")].astype(np.uint32),
        np.ascontiguousarray(model.skin_links[order][:, used], np.uint32),
        np.ascontiguousarray(model.skin_weights[order][:, used]),
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
