"""A body model laid out for the kernel: neighbouring vertices together, fixed dtypes. Done once per model."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, BodyModel
from worker.observation import morton_codes


class Skeleton(NamedTuple):
    """The part of a body model that moves."""

    kinds: NDArray[np.int64]  # (D,)
    parents: NDArray[np.int64]  # (D,)
    axes: NDArray[np.float64]  # (D, 3)
    points: NDArray[np.float64]  # (D, 3)
    limits: NDArray[np.float64]  # (D, 2)
    balls: NDArray[np.int64]  # (B,)
    link_dofs: NDArray[np.int64]  # (L,)
    root: NDArray[np.bool_]  # (D,) which of them place the body in the world


class Surface(NamedTuple):
    """The part that is seen, with vertices in Morton order of the rest pose."""

    vertices: NDArray[np.float64]  # (V, 3)
    triangles: NDArray[np.int64]  # (T, 3)
    skin_links: NDArray[np.int64]  # (V, K)
    skin_weights: NDArray[np.float64]  # (V, K)


@lru_cache(maxsize=16)
def lay_out(model: BodyModel) -> tuple[Skeleton, Surface]:
    """Skeleton and surface of a model; kept, as a model never changes."""
    order = np.argsort(morton_codes(model.vertices), kind="stable")
    rank = np.argsort(order, kind="stable")
    skeleton = Skeleton(
        model.kinds,
        model.parents,
        model.axes,
        model.points,
        model.limits,
        model.balls,
        model.link_dofs,
        np.array([name in ROOT_DOFS for name in model.dof_names]),
    )
    surface = Surface(
        np.ascontiguousarray(model.vertices[order]),
        np.ascontiguousarray(rank[model.triangles]),
        np.ascontiguousarray(model.skin_links[order]),
        np.ascontiguousarray(model.skin_weights[order]),
    )
    return skeleton, surface
