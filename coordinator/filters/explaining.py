"""Which observed points a body comes near, limb by limb, and how many of them a limb would, held otherwise.

What compiled loops go over comes last in its array, so that they take several at once.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from common.kinematics.chain import forward_kinematics

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

NEAR = 0.08  # metres from the surface within which a point is explained


@numba.njit(cache=True, nogil=True)
def mark_by_limb(points: Array, vertices: Array, limb_of: Indices, near: Flags) -> None:
    """Set near (K, P) where points (3, P) are near the vertices (V, 3) of each limb, clear it elsewhere."""
    near[:] = False
    for v in range(len(vertices)):
        mark_near(vertices[v], points, near[limb_of[v]])


@numba.njit(cache=True, nogil=True)
def count_explained(  # noqa: PLR0913 a kernel
    kinds: Indices,
    parents: Indices,
    axes: Array,
    joints: Array,
    pose: Array,
    held: Array,
    vertices: Array,
    carriers: Indices,
    points: Array,
    explained: Array,
) -> None:
    """Fill explained (K,): of points (P, 3) that are near vertices (V, 3) of a limb, held in ways (K, d).

    The limb's degrees of freedom are the last d of its chain (C,), whose pose (C,) is that of the last way
    in the end.
    """
    posed = np.empty((len(vertices), 3, len(held)))
    transforms = np.empty((len(kinds), 3, 4))
    for k in range(len(held)):
        pose[len(kinds) - held.shape[1] :] = held[k]
        forward_kinematics(kinds, parents, axes, joints, pose, transforms)
        for v in range(len(vertices)):
            t = transforms[carriers[v]]
            for a in range(3):
                posed[v, a, k] = (
                    t[a, 0] * vertices[v, 0] + t[a, 1] * vertices[v, 1] + t[a, 2] * vertices[v, 2] + t[a, 3]
                )
    near = np.zeros((len(points), len(held)), dtype=np.bool_)
    for v in range(len(vertices)):
        for p in range(len(points)):
            mark_near(points[p], posed[v], near[p])
    explained[:] = 0.0
    for p in range(len(points)):
        for k in range(len(held)):
            explained[k] += near[p, k]


@numba.njit(cache=True, nogil=True)
def mark_near(point: Array, others: Array, near: Flags) -> None:
    """Set near (P,) where others (3, P) are near a point (3,)."""
    x, y, z = point[0], point[1], point[2]
    for p in range(others.shape[1]):
        dx, dy, dz = others[0, p] - x, others[1, p] - y, others[2, p] - z
        near[p] |= dx * dx + dy * dy + dz * dz <= NEAR * NEAR
