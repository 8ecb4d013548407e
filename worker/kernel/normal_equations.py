"""The normal equations of Eq. 3-5 from sums over correspondences, without the points themselves.

The model is linear in each link's transform. With X = [p; 1] a model point at rest, p~ the observed point
that belongs to it and T the link's T_rig_rest, the sums M_s = sum w X X^T and C_s = sum w X p~^T of each
link s hold all that Eq. 3-5 need. A degree of freedom j moves a point x in the rig's frame, x = T X, by
w_j x (x - q_j) = w_j x x + v_j for a rotation (Eq. 2), with v_j = q_j x w_j; its twist is (w_j, v_j). So

    (J^T J)_jk = twist_j . wrench of the forces w G (w_k x x + v_k) at the points x,
    (J^T r)_j = twist_j . wrench of the forces w G (x - p~),

summed over the cameras, each with the metric G of its noise, and over the links that j and k move, or that j
moves. A wrench is torque about the rig's origin, and force. It is a sum over products of forces with x, which
T M_s T^T and T C_s contain (Featherstone, Rigid Body Dynamics Algorithms, section 6.2). So the cost of a step
does not depend on the number of points.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import TRANSLATION
from gepf.common.compiling import numba
from gepf.common.kinematics.chain import motion_axes
from gepf.worker.kernel.surface import Skeleton
from gepf.worker.kernel.workspace import Equations

Wrench = tuple[float, float, float, float, float, float]  # torque about the rig's origin, force


@numba.njit(cache=True, nogil=True)
def fill_normal_equations(
    skeleton: Skeleton, transforms: Array, stretch: float, equations: Equations
) -> None:
    """Fill the lower part of gram (D, D) with J^T J, and gradient (D,) with J^T r, of Eq. 4.

    transforms (D + 1, 3, 4) are T. Residuals along a camera's axis are multiplied by `stretch`.
    """
    gram, gradient, parents = equations.gram, equations.gradient, skeleton.parents
    twists, moments = twists_of(skeleton, transforms), np.empty((3, 4))
    gram[:, :], gradient[:] = 0.0, 0.0
    for v in range(len(equations.sums)):
        sums = sum_subtrees(skeleton, transforms, equations.sums[v])
        metric = metric_of(equations.turns[v], stretch)
        for k in range(len(gradient)):
            s, wx, wy, wz = sums[k], twists[k, 0], twists[k, 1], twists[k, 2]
            for r in range(3):
                for b in range(4):
                    moments[r, b] = s[b, r] - s[b, 4 + r]
            gradient[k] += power(twists[k], wrench_of(moments, metric))
            for b in range(4):
                moments[0, b] = wy * s[2, b] - wz * s[1, b] + twists[k, 3] * s[3, b]
                moments[1, b] = wz * s[0, b] - wx * s[2, b] + twists[k, 4] * s[3, b]
                moments[2, b] = wx * s[1, b] - wy * s[0, b] + twists[k, 5] * s[3, b]
            wrench = wrench_of(moments, metric)
            j = k
            while j >= 0:  # only ancestors share moved links
                gram[k, j] += power(twists[j], wrench)
                j = parents[j]


@numba.njit(cache=True, nogil=True)
def metric_of(turn: Array, stretch: float) -> Array:
    """The metric (3, 3), in the rig's frame, of a camera that the rotation `turn` leads to."""
    metric = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            along = stretch * stretch * turn[2, a] * turn[2, b]
            metric[a, b] = turn[0, a] * turn[0, b] + turn[1, a] * turn[1, b] + along
    return metric


@numba.njit(cache=True, nogil=True)
def twists_of(skeleton: Skeleton, transforms: Array) -> Array:
    """Twists (D, 6) of all degrees of freedom about the rig's origin: w, v; w is zero for a translation."""
    w, q = np.empty((len(skeleton.parents), 3)), np.empty((len(skeleton.parents), 3))
    motion_axes(skeleton.parents, skeleton.axes, skeleton.points, skeleton.balls, transforms, w, q)
    twists = np.zeros((len(w), 6))
    for j in range(len(w)):
        if skeleton.kinds[j] == TRANSLATION:
            twists[j, 3:] = w[j]
        else:
            twists[j, :3] = w[j]
            twists[j, 3] = q[j, 1] * w[j, 2] - q[j, 2] * w[j, 1]
            twists[j, 4] = q[j, 2] * w[j, 0] - q[j, 0] * w[j, 2]
            twists[j, 5] = q[j, 0] * w[j, 1] - q[j, 1] * w[j, 0]
    return twists


@numba.njit(cache=True, nogil=True, inline="always")
def wrench_of(moments: Array, metric: Array) -> Wrench:
    """The wrench of forces G f from the sums (3, 4) of f [x; 1]^T, with a symmetric metric G (3, 3)."""
    g, m = metric, moments
    return (
        force(g, m, 2, 1) - force(g, m, 1, 2),
        force(g, m, 0, 2) - force(g, m, 2, 0),
        force(g, m, 1, 0) - force(g, m, 0, 1),
        force(g, m, 0, 3),
        force(g, m, 1, 3),
        force(g, m, 2, 3),
    )


@numba.njit(cache=True, nogil=True, inline="always")
def force(metric: Array, moments: Array, a: int, b: int) -> float:
    """Entry (a, b) of the product of a metric (3, 3) and moments (3, 4)."""
    total: float = metric[a, 0] * moments[0, b] + metric[a, 1] * moments[1, b] + metric[a, 2] * moments[2, b]
    return total


@numba.njit(cache=True, nogil=True, inline="always")
def power(twist: Array, wrench: Wrench | Array) -> float:
    """The product of a twist (6,) and a wrench."""
    turning: float = twist[0] * wrench[0] + twist[1] * wrench[1] + twist[2] * wrench[2]
    moving: float = twist[3] * wrench[3] + twist[4] * wrench[4] + twist[5] * wrench[5]
    return turning + moving


@numba.njit(cache=True, nogil=True)
def sum_subtrees(skeleton: Skeleton, transforms: Array, sums: Array) -> Array:
    """Sums (D, 4, 7) of T M T^T and T C over the links that each degree of freedom moves."""
    parents, link_dofs = skeleton.parents, skeleton.link_dofs
    subtrees, half = np.zeros((len(parents), 4, 7)), np.empty((4, 8))
    for s in range(len(link_dofs)):
        if link_dofs[s] >= 0 and sums[s, 3, 3] > 0.0:
            add_link(transforms[link_dofs[s]], sums[s], half, subtrees[link_dofs[s]])
    for j in range(len(parents) - 1, 0, -1):
        if parents[j] >= 0:
            subtrees[parents[j]] += subtrees[j]
    return subtrees


@numba.njit(cache=True, nogil=True)
def add_link(t: Array, sums: Array, half: Array, out: Array) -> None:
    """Add T M T^T and T C to out (4, 7), for t (3, 4) and sums (4, 8), by way of half (4, 8)."""
    half[3] = sums[3]  # the last row of T is [0, 0, 0, 1]
    for a in range(3):
        for b in range(7):
            half[a, b] = (
                t[a, 0] * sums[0, b] + t[a, 1] * sums[1, b] + t[a, 2] * sums[2, b] + t[a, 3] * sums[3, b]
            )
    for a in range(4):
        for b in range(3):
            out[a, b] += (
                t[b, 0] * half[a, 0] + t[b, 1] * half[a, 1] + t[b, 2] * half[a, 2] + t[b, 3] * half[a, 3]
            )
        for b in range(3, 7):
            out[a, b] += half[a, b]
