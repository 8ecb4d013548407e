"""Which observed points a body comes near, limb by limb, and how many of them a limb would, held otherwise.

What compiled loops go over comes last in its array, so that they take several at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.kinematics.chain import compose, fill_turn, forward_kinematics

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
def compare_limbs(near: Flags, alone: Flags, own: Indices) -> int:
    """How many points no limb is near, by near (K, P); and limb by limb what its points are to others.

    Fills alone (K, P) where no other limb is near a point, and own (K,) with how many each has for itself.
    """
    unexplained = 0
    own[:] = 0
    for p in range(near.shape[1]):
        limbs = 0
        for k in range(len(near)):
            limbs += near[k, p]
        unexplained += limbs == 0
        for k in range(len(near)):
            alone[k, p] = limbs == near[k, p]
            own[k] += near[k, p] and limbs == 1
    return unexplained


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

    The limb's degrees of freedom turn, and are the last d of its chain (C,); carriers (V,) are among these d.
    """
    transforms = np.empty((len(kinds), 3, 4))
    of_limb = np.empty((held.shape[1], 3, 4, len(held)))  # in each of the ways
    first = len(kinds) - held.shape[1]
    local = np.empty((3, 4))
    forward_kinematics(kinds, parents, axes, joints, pose, transforms)
    for k in range(len(held)):
        for i in range(held.shape[1]):
            fill_turn(axes, joints, first + i, held[k, i], local)
            compose(parents[first + i], local, first + i, transforms)
        of_limb[:, :, :, k] = transforms[first:]
    posed = np.empty((len(vertices), 3, len(held)))
    for v in range(len(vertices)):
        x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
        for a in range(3):
            t = of_limb[carriers[v], a]
            for k in range(len(held)):
                posed[v, a, k] = t[0, k] * x + t[1, k] * y + t[2, k] * z + t[3, k]
    explained[:] = 0.0
    nearest = np.empty(len(held))
    for p in range(len(points)):
        nearest[:] = np.inf
        for v in range(len(vertices)):
            for k in range(len(held)):
                dx, dy = posed[v, 0, k] - points[p, 0], posed[v, 1, k] - points[p, 1]
                dz = posed[v, 2, k] - points[p, 2]
                squared = dx * dx + dy * dy + dz * dz
                nearest[k] = min(nearest[k], squared)
        for k in range(len(held)):
            explained[k] += nearest[k] <= NEAR * NEAR


@numba.njit(cache=True, nogil=True)
def try_and_vary(  # noqa: PLR0913 a kernel
    kinds: Indices,
    parents: Indices,
    axes: Array,
    joints: Array,
    pose: Array,
    low: Array,
    high: Array,
    held: Array,
    variation: Array,
    vertices: Array,
    carriers: Indices,
    points: Array,
    ways: Array,
    explained: Array,
) -> None:
    """Fill ways (B + V, d) with the best B of held (N, d), and with each of them varied V / B times.

    Variations (V, d) are in turn those of the best, of the next, and so on; low and high (d,) are limits.
    Fills explained (B + V,) for them, and all else is, as in `count_explained`.
    """
    first, best = np.empty(len(held)), len(ways) - len(variation)
    count_explained(kinds, parents, axes, joints, pose, held, vertices, carriers, points, first)
    order = np.argsort(-first, kind="mergesort")  # of equals the first
    for b in range(best):
        ways[b], explained[b] = held[order[b]], first[order[b]]
    for v in range(len(variation)):
        for j in range(len(low)):
            varied = ways[v * best // len(variation), j] + variation[v, j]
            ways[best + v, j] = min(max(varied, low[j]), high[j])
    others = ways[best:]
    count_explained(kinds, parents, axes, joints, pose, others, vertices, carriers, points, explained[best:])


@numba.njit(cache=True, nogil=True)
def mark_near(point: Array, others: Array, near: Flags) -> None:
    """Set near (P,) where others (3, P) are near a point (3,)."""
    x, y, z = point[0], point[1], point[2]
    for p in range(others.shape[1]):
        dx, dy, dz = others[0, p] - x, others[1, p] - y, others[2, p] - z
        near[p] |= dx * dx + dy * dy + dz * dz <= NEAR * NEAR
