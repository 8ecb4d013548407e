"""The normal equations of Eq. 3-5 from sums over correspondences, without the points themselves.

The model is linear in each link's transform. With X = [p; 1] a model point at rest, p~ the observed point
that belongs to it and T the link's T_camera_rest, the sums M_s = sum w X X^T and C_s = sum w X p~^T of each
link s hold all that Eq. 3-5 need: with A_j = [w_j]x [I | -q_j] for a rotation, column j of the Jacobian is
A_j T X, so

    (J^T J)_jk = sum_s tr(A_j T M_s T^T A_k^T)    (J^T r)_j = sum_s tr(A_j T (M_s T^T E - C_s)),
    E = [I | 0]^T

over the links s that both degrees of freedom, or the one, move. So the cost of a step does not depend on the
number of points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.kinematics.chain import motion_axes
from worker.kernel.surface import Skeleton
from worker.kernel.workspace import Equations

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def fill_normal_equations(
    skeleton: Skeleton, transforms: Array, stretch: float, equations: Equations
) -> None:
    """Fill gram (D, D) with J^T J and gradient (D,) with J^T r of Eq. 4 with transforms (D + 1, 3, 4) as T.

    Residuals along the camera's axis are multiplied by `stretch`.
    """
    gram, gradient, parents = equations.gram, equations.gradient, skeleton.parents
    dofs = len(gradient)
    w, q = np.empty((dofs, 3)), np.empty((dofs, 3))
    motion_axes(parents, skeleton.axes, skeleton.points, skeleton.balls, transforms, w, q)
    sums = sum_subtrees(skeleton, transforms, equations.sums)
    jacobians, product = np.empty((dofs, 3, 4)), np.empty((3, 4))
    gram[:, :] = 0.0
    for k in range(dofs):
        fill_jacobian(skeleton.kinds[k], w[k], q[k], jacobians[k])
        gradient[k] = 0.0
        for r in range(3):
            metric = stretch * stretch if r == 2 else 1.0
            for b in range(4):
                total = 0.0
                for a in range(4):
                    total += jacobians[k, r, a] * sums[k, a, b]
                product[r, b] = metric * total
                gradient[k] += metric * jacobians[k, r, b] * (sums[k, b, r] - sums[k, b, 4 + r])
        j = k
        while j >= 0:  # only ancestors share moved links
            total = 0.0
            for r in range(3):
                for b in range(4):
                    total += product[r, b] * jacobians[j, r, b]
            gram[j, k] = gram[k, j] = total
            j = parents[j]


@numba.njit(cache=True, nogil=True)
def sum_subtrees(skeleton: Skeleton, transforms: Array, sums: Array) -> Array:
    """Sums (D, 4, 7) of T M T^T and T C over the links that each degree of freedom moves."""
    parents, link_dofs = skeleton.parents, skeleton.link_dofs
    subtrees, half = np.zeros((len(parents), 4, 7)), np.empty((4, 7))
    for s in range(len(link_dofs)):
        if link_dofs[s] >= 0 and sums[s, 3, 3] > 0.0:
            add_link(transforms[link_dofs[s]], sums[s], half, subtrees[link_dofs[s]])
    for j in range(len(parents) - 1, 0, -1):
        if parents[j] >= 0:
            subtrees[parents[j]] += subtrees[j]
    return subtrees


@numba.njit(cache=True, nogil=True)
def add_link(t: Array, sums: Array, half: Array, out: Array) -> None:
    """Add T M T^T and T C to out (4, 7), for t (3, 4) and sums (4, 7), by way of half (4, 7)."""
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


@numba.njit(cache=True, nogil=True)
def fill_jacobian(kind: int, w: Array, q: Array, out: Array) -> None:
    """Fill out with A (3, 4): A [p; 1] = w x (p - q), the derivative of Eq. 2; for a translation, = w."""
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
