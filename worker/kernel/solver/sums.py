"""The sums over correspondences of which the normal equations are made.

A vertex that is blended over several links adds to each of them in proportion to its weights, from where that
link alone would carry it, with the residual of the blend. That leaves J^T r exact at the pose in which
correspondences were searched, and makes J^T J an upper bound, so steps stay safe.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.rows import add_products
from worker.kernel.solver.normal_equations import NormalEquations
from worker.kernel.surface import Skeleton, Surface

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def add_correspondences(
    surface: Surface,
    skeleton: Skeleton,
    transforms: Array,
    visible: NDArray[np.uint32],
    posed: Array,
    weighted_targets: Array,
    equations: NormalEquations,
) -> None:
    """Sum moments and crosses of the visible ones of posed (V, 3) with their observed points.

    weighted_targets (V, 4) are those points' weighted sum and weight, in the order of `visible`. transforms
    (D + 1, 3, 4) are T_camera_rest, the last for links that nothing moves.
    """
    links, weights, sums, pulls = surface.skin_links, surface.skin_weights, equations.sums, weighted_targets
    sums[:] = 0.0
    for m in range(len(visible)):
        v = visible[m]
        w = pulls[m, 3]
        if w > 0.0:
            x, y, z, cx, cy, cz = posed[v, 0], posed[v, 1], posed[v, 2], pulls[m, 0], pulls[m, 1], pulls[m, 2]
            if not weights[v, 0] < 1.0:
                add_products(sums, links[v, 0], 1.0, x, y, z, cx, cy, cz, w)  # type: ignore[call-arg]
            else:
                add_blended(surface, skeleton.link_dofs, transforms, v, x, y, z, cx, cy, cz, w, sums)
    equations.moments[:] = sums[:, :, :4]
    equations.crosses[:] = sums[:, :, 4:7]


@numba.njit(cache=True, nogil=True)
def add_blended(  # noqa: PLR0913 compiled code takes numbers
    surface: Surface,
    link_dofs: NDArray[np.int64],
    transforms: Array,
    v: int,
    x: float,
    y: float,
    z: float,
    cx: float,
    cy: float,
    cz: float,
    w: float,
    sums: Array,
) -> None:
    """Add vertex v, which is at (x, y, z), as part of each of its links; (cx, cy, cz) and w are its pull.

    By numbers, not by rows: a row that is taken out of an array counts references.
    """
    px, py, pz = surface.vertices[v, 0], surface.vertices[v, 1], surface.vertices[v, 2]
    for k in range(surface.skin_links.shape[1]):
        share = surface.skin_weights[v, k]
        if not share > 0.0:
            break
        link = surface.skin_links[v, k]
        t = link_dofs[link]
        carried_x = carried(transforms, t, 0, px, py, pz)
        carried_y = carried(transforms, t, 1, px, py, pz)
        carried_z = carried(transforms, t, 2, px, py, pz)
        cx += w * (carried_x - x)  # the target moves along, so that the residual stays the blend's
        cy += w * (carried_y - y)
        cz += w * (carried_z - z)
        x, y, z = carried_x, carried_y, carried_z
        add_products(sums, link, share, x, y, z, cx, cy, cz, w)  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True)
def carried(transforms: Array, t: int, axis: int, x: float, y: float, z: float) -> float:
    """One coordinate of where transform t of (D + 1, 3, 4) takes a point."""
    moved: float = (
        transforms[t, axis, 0] * x
        + transforms[t, axis, 1] * y
        + transforms[t, axis, 2] * z
        + transforms[t, axis, 3]
    )
    return moved
