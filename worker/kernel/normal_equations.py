"""The normal equations of Eq. 3-5 from sums over correspondences, without the points themselves.

The model is linear in each link's transform. With X = [p; 1] a model point and p~ the observed point that
belongs to it, the sums M_s = sum w X X^T and C_s = sum w X p~^T of each link s hold all that Eq. 3-5 need:
with A_j = [w_j]x [I | -q_j] for a rotation, column j of the Jacobian is A_j X, so

    (J^T J)_jk = sum_s tr(A_j M_s A_k^T)        (J^T r)_j = sum_s tr(A_j (M_s E - C_s)),  E = [I | 0]^T

over the links s that both (that) degrees of freedom move. A link's relative motion G takes M_s to
G M_s G^T and C_s to G C_s, so a step costs the same for a thousand points as for a million.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.kinematics.chain import motion_axes
from worker.kernel.surface import Skeleton
from worker.kernel.workspace import NormalEquations

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def subtree_moments(skeleton: Skeleton, equations: NormalEquations) -> None:
    """Moments (D, 4, 4) and (D, 4, 3), at the moved pose, of all that each degree of freedom moves."""
    moments, crosses = equations.moments, equations.crosses
    subtree_m, subtree_c = equations.subtree_m, equations.subtree_c
    subtree_m[:] = 0.0
    subtree_c[:] = 0.0
    g, half = np.eye(4), np.empty((4, 4))
    for s in range(len(skeleton.link_dofs)):
        j = skeleton.link_dofs[s]
        if j < 0 or moments[s, 3, 3] == 0.0:
            continue
        relative_motion(equations.reference, equations.moved, j, g)
        multiply(g, moments, s, half)
        for a in range(4):
            for b in range(4):
                for c in range(4):
                    subtree_m[j, a, b] += half[a, c] * g[b, c]
                    if b < 3:
                        subtree_c[j, a, b] += g[a, c] * crosses[s, c, b]
    for j in range(len(subtree_m) - 1, 0, -1):
        if skeleton.parents[j] >= 0:
            add_to_parent(subtree_m, subtree_c, j, skeleton.parents[j])


@numba.njit(cache=True, nogil=True)
def add_to_parent(subtree_m: Array, subtree_c: Array, j: int, parent: int) -> None:
    """Add what degree of freedom j moves to what its parent moves."""
    for a in range(4):
        for b in range(4):
            subtree_m[parent, a, b] += subtree_m[j, a, b]
        for b in range(3):
            subtree_c[parent, a, b] += subtree_c[j, a, b]


@numba.njit(cache=True, nogil=True)
def relative_motion(before: Array, after: Array, j: int, g: Array) -> None:
    """g[:3] (3, 4) = after[j] o before[j]^-1 for rigid transforms (D, 3, 4)."""
    for a in range(3):
        for b in range(3):
            g[a, b] = (
                after[j, a, 0] * before[j, b, 0]
                + after[j, a, 1] * before[j, b, 1]
                + after[j, a, 2] * before[j, b, 2]
            )
        g[a, 3] = after[j, a, 3]
        for b in range(3):
            g[a, 3] -= g[a, b] * before[j, b, 3]


@numba.njit(cache=True, nogil=True)
def multiply(one: Array, others: Array, s: int, out: Array) -> None:
    """out = one @ others[s], (4, 4)."""
    for a in range(4):
        for b in range(4):
            out[a, b] = (
                one[a, 0] * others[s, 0, b]
                + one[a, 1] * others[s, 1, b]
                + one[a, 2] * others[s, 2, b]
                + one[a, 3] * others[s, 3, b]
            )


@numba.njit(cache=True, nogil=True)
def normal_equations(skeleton: Skeleton, metric: Array, equations: NormalEquations) -> None:
    """Fill gram (D, D) with J^T J and gradient (D,) with J^T r of Eq. 4 at the moved pose."""
    w, q, columns, m, c = (
        equations.w,
        equations.q,
        equations.columns,
        equations.subtree_m,
        equations.subtree_c,
    )
    gram, gradient = equations.gram, equations.gradient
    motion_axes(skeleton.parents, skeleton.axes, skeleton.points, skeleton.balls, equations.moved, w, q)
    gram[:, :] = 0.0
    product = np.empty((3, 4))
    for k in range(len(gram)):
        jacobian_matrix(skeleton.kinds[k], w[k], q[k], columns[k])
        gradient[k] = 0.0
        for r in range(3):
            for b in range(4):
                product[r, b] = 0.0
                for a in range(4):
                    product[r, b] += columns[k, r, a] * m[k, a, b]
                gradient[k] += metric[r] * columns[k, r, b] * (m[k, b, r] - c[k, b, r])
        j = k
        while j >= 0:  # only ancestors share moved links
            total = 0.0
            for r in range(3):
                for b in range(4):
                    total += metric[r] * product[r, b] * columns[j, r, b]
            gram[j, k] = gram[k, j] = total
            j = skeleton.parents[j]


@numba.njit(cache=True, nogil=True)
def jacobian_matrix(kind: int, w: Array, q: Array, out: Array) -> None:
    """A (3, 4) with A [p; 1] = w x (p - q), the derivative of a point by Eq. 2; for a translation, = w."""
    out[:, :] = 0.0
    if kind == 0:
        out[0, 3], out[1, 3], out[2, 3] = w[0], w[1], w[2]
    else:
        out[0, 1], out[0, 2] = -w[2], w[1]
        out[1, 0], out[1, 2] = w[2], -w[0]
        out[2, 0], out[2, 1] = -w[1], w[0]
        out[0, 3] = -(w[1] * q[2] - w[2] * q[1])
        out[1, 3] = -(w[2] * q[0] - w[0] * q[2])
        out[2, 3] = -(w[0] * q[1] - w[1] * q[0])
