"""Sums over the targets of a link's vertices, which replace the points in all Gauss-Newton iterations.

Depth and free space have residuals with one metric G per camera: that of its noise, along and across. Each
visible vertex has a weighted sum of targets. With X = [p; 1] a model point at rest, p~ a target of it, g its
weight and T the link's T_rig_rest, the sums M_s = sum g X X^T and C_s = sum g X p~^T of each link s give the
link's wrench and matrix (see `normal_equations`) at any transform. With x = T X, the wrench is that of the
forces g G (x - p~), and the columns of the matrix are the wrenches of the forces g G (w x x + v) for unit
twists (w, v). A wrench is a sum over products of forces with x, which T M_s T^T and T C_s contain. So the
cost of a step does not depend on the number of points.

A vertex that is skinned to several links contributes to each of them in proportion to its weights: at the
position to which that link alone would move it, with the residual of the skinned vertex. So the gradient is
exact at the pose of the correspondences, and the matrix is an upper bound, which keeps steps from being too
long.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.worker.kernel.vectors import add_scaled
from gepf.worker.kernel.workspace import CameraView


@numba.njit(cache=True, nogil=True)
def sum_by_link(view: CameraView) -> None:
    """Sum M and C of each link over the visible vertices of a camera into workspace.sums.

    The target is shifted with the vertex to the position to which the link alone moves it. So the residual
    stays that of the skinned vertex: with T the link's transform in the rig now, and e the weighted residual
    in the rig's frame, C_s = sum X e^T + M_s T^T.
    """
    visible, workspace = view.visible, view.workspace
    surface = view.problem.surface
    vertices, links, weights = surface.vertices, surface.skin_links, surface.skin_weights
    posed, targets, sums = workspace.posed, workspace.targets, workspace.sums
    sums[:] = 0.0
    for m in range(len(visible)):
        w, v = targets[m, 3], visible[m]
        if w > 0.0:
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            ex, ey, ez = (
                targets[m, 0] - w * posed[v, 0],
                targets[m, 1] - w * posed[v, 1],
                targets[m, 2] - w * posed[v, 2],
            )
            row = w * x, w * y, w * z, w, ex, ey, ez, 0.0
            for k in range(links.shape[1]):
                share, first = weights[v, k], 4 * links[v, k]
                if share > 0.0:
                    add_scaled(sums, first, share * x, row)  # type: ignore[call-arg]
                    add_scaled(sums, first + 1, share * y, row)
                    add_scaled(sums, first + 2, share * z, row)
                    add_scaled(sums, first + 3, share, row)
    turn = workspace.T_camera_rig
    for link in range(len(sums)):
        t = workspace.of_links[link]
        for a in range(4):
            ex, ey, ez = sums[link, a, 4], sums[link, a, 5], sums[link, a, 6]
            for b in range(3):
                total = turn[0, b] * ex + turn[1, b] * ey + turn[2, b] * ez
                for c in range(4):
                    total += sums[link, a, c] * t[b, c]
                sums[link, a, 4 + b] = total


@numba.njit(cache=True, nogil=True)
def add_link(t: Array, sums: Array, metric: Array, fields: Array, scratch: Array, out: Array) -> None:
    """Add the matrix and the wrench of a link to out (6 + S, 7 + S).

    For the link's transform t (3, 4) of `Workspace.of_links`, its sums (4, 8), the metric G (3, 3) and the
    fields (S, 3, 4) of shape in the rig. scratch (4, 3, 4) holds intermediate results.
    """
    half, residuals, moments, forces = scratch[0], scratch[1], scratch[2], scratch[3]
    multiply(t, sums, half)  # of x X^T
    for a in range(3):
        for b in range(4):
            residuals[a, b] = half[a, b] - sums[b, 4 + a]  # of (x - p~) X^T
    multiply_transposed(half, t, moments)  # of x [x; 1]^T
    add_matrix(moments, sums[3, 3], metric, forces, out)
    multiply(metric, residuals, forces)
    for s in range(len(fields)):
        out[6 + s, -1] += total_product(fields[s], forces)
    multiply_transposed(forces, t, moments)
    add_wrench(moments, out.shape[1] - 1, out)
    add_shape(t, sums, metric, fields, moments, forces, out)


@numba.njit(cache=True, nogil=True)
def add_matrix(moments: Array, mass: float, metric: Array, weighted: Array, out: Array) -> None:
    """Add the matrix of a rigid link to the first entries (6, 6) of out.

    moments (3, 4) are [P p] with P = sum w x x^T and p = sum w x; the mass is sum w. The velocity of x is
    v - [x] w, with [x] y = x x y. So the matrix is sum w [-[x] 1]^T G [-[x] 1], with the blocks m G, -G [p],
    and, for symmetric G,

        -sum w [x] G [x] = (tr G tr P - tr GP) 1 - tr G P - tr P G + GP + (GP)^T.

    weighted (3, 4) receives G [P p].
    """
    multiply(metric, moments, weighted)
    trace = metric[0, 0] + metric[1, 1] + metric[2, 2]
    spread = moments[0, 0] + moments[1, 1] + moments[2, 2]
    both = trace * spread - weighted[0, 0] - weighted[1, 1] - weighted[2, 2]
    for a in range(3):
        out[a, a] += both
        for b in range(3):
            out[a, b] += weighted[a, b] + weighted[b, a] - trace * moments[a, b] - spread * metric[a, b]
            out[3 + a, 3 + b] += mass * metric[a, b]
            c, d = (b + 1) % 3, (b + 2) % 3
            lever = metric[a, d] * moments[c, 3] - metric[a, c] * moments[d, 3]  # of G (e_b x p)
            out[3 + a, b] += lever
            out[b, 3 + a] += lever


@numba.njit(cache=True, nogil=True)
def add_shape(
    t: Array, sums: Array, metric: Array, fields: Array, moments: Array, forces: Array, out: Array
) -> None:
    """Add the rows and columns of shape, but not the derivatives, to out (6 + S, 7 + S).

    A coefficient displaces a point X by f = F X. The entry of two coefficients, with f and f', is the sum of
    w f . G f'; the column of a coefficient is the wrench of the forces w G f. moments and forces (3, 4) hold
    intermediate results.
    """
    for s in range(len(fields)):
        multiply(fields[s], sums, moments)  # of f X^T
        multiply(metric, moments, forces)
        for k in range(s + 1):
            total = total_product(fields[k], forces)
            out[6 + s, 6 + k] += total
            if k < s:
                out[6 + k, 6 + s] += total
        for a in range(6):
            out[6 + s, a] -= out[a, 6 + s]
        multiply_transposed(forces, t, moments)  # of G f [x; 1]^T
        add_wrench(moments, 6 + s, out)
        for a in range(6):
            out[6 + s, a] += out[a, 6 + s]


@numba.njit(cache=True, nogil=True)
def multiply(t: Array, sums: Array, out: Array) -> None:
    """Fill out (3, 4) with the product of t, (3, 4) or (3, 3), and the first columns of sums."""
    for a in range(3):
        for b in range(4):
            total = t[a, 0] * sums[0, b] + t[a, 1] * sums[1, b] + t[a, 2] * sums[2, b]
            out[a, b] = total + t[a, 3] * sums[3, b] if t.shape[1] == 4 else total


@numba.njit(cache=True, nogil=True)
def multiply_transposed(moments: Array, t: Array, out: Array) -> None:
    """Fill out (3, 4) with the product of moments (3, 4) and [t; 0 0 0 1]^T."""
    m = moments
    for a in range(3):
        for b in range(3):
            out[a, b] = m[a, 0] * t[b, 0] + m[a, 1] * t[b, 1] + m[a, 2] * t[b, 2] + m[a, 3] * t[b, 3]
        out[a, 3] = m[a, 3]


@numba.njit(cache=True, nogil=True)
def total_product(first: Array, second: Array) -> float:
    """The sum of the entrywise products of two matrices (3, 4)."""
    total = 0.0
    for a in range(3):
        for b in range(4):
            total += first[a, b] * second[a, b]
    return total


@numba.njit(cache=True, nogil=True)
def add_wrench(forces: Array, column: int, out: Array) -> None:
    """Add the wrench of forces f, from the sums (3, 4) of f [x; 1]^T, to a column of out."""
    out[0, column] += forces[2, 1] - forces[1, 2]
    out[1, column] += forces[0, 2] - forces[2, 0]
    out[2, column] += forces[1, 0] - forces[0, 1]
    for a in range(3):
        out[3 + a, column] += forces[a, 3]


@numba.njit(cache=True, nogil=True)
def metric_of(turn: Array, stretch: float) -> Array:
    """The metric (3, 3), in the rig's frame, of the camera into whose frame `turn` rotates."""
    metric = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            along = stretch * stretch * turn[2, a] * turn[2, b]
            metric[a, b] = turn[0, a] * turn[0, b] + turn[1, a] * turn[1, b] + along
    return metric
