"""Sums over the targets of a link's vertices, which replace the points in all Gauss-Newton iterations.

Depth and free space have residuals with one metric G per camera: that of its noise, along and across. Each
visible vertex has a weighted sum of targets. With X = [p; 1] a model point at rest, p~ a target of it, g its
weight and T the link's T_rig_rest, the sums M_s = sum g X X^T and C_s = sum g X p~^T of each link s give the
link's wrench and matrix (see `normal_equations`) at any transform. At the point x = T X they are of the
forces g G (x - p~), and g G (w x x + v) for unit twists (w, v). A wrench is a sum over products of forces
with x, which T M_s T^T and T C_s contain. So the cost of a step does not depend on the number of points.

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
    skeleton, surface = view.problem.skeleton, view.problem.surface
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
        t = workspace.of_rig[skeleton.link_dofs[link]]
        for a in range(4):
            ex, ey, ez = sums[link, a, 4], sums[link, a, 5], sums[link, a, 6]
            for b in range(3):
                total = turn[0, b] * ex + turn[1, b] * ey + turn[2, b] * ez
                for c in range(4):
                    total += sums[link, a, c] * t[b, c]
                sums[link, a, 4 + b] = total


@numba.njit(cache=True, nogil=True)
def add_wrenches(t: Array, sums: Array, metric: Array, scratch: Array, out: Array) -> None:
    """Add the matrix and the wrench of a link to out (6, 7), for its T_rig_rest t (3, 4) and sums (4, 8).

    scratch (3, 4, 8) holds intermediate results.
    """
    moved, moments = scratch[0], scratch[1]
    move_sums(t, sums, scratch[2], moved)
    for a in range(3):
        for k in range(4):
            moments[a, k] = moved[k, a] - moved[k, 4 + a]
    add_wrench(moments, metric, 6, out)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for k in range(4):  # of e_a x x
            moments[a, k], moments[b, k], moments[c, k] = 0.0, -moved[c, k], moved[b, k]
        add_wrench(moments, metric, a, out)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        for k in range(4):  # of e_a
            moments[a, k], moments[b, k], moments[c, k] = moved[3, k], 0.0, 0.0
        add_wrench(moments, metric, 3 + a, out)


@numba.njit(cache=True, nogil=True)
def move_sums(t: Array, sums: Array, half: Array, out: Array) -> None:
    """Fill out (4, 7) with T M T^T and T C, for t (3, 4) and sums (4, 8), by way of half (4, 8)."""
    half[3] = sums[3]  # the last row of T is [0, 0, 0, 1]
    for a in range(3):
        for b in range(7):
            half[a, b] = (
                t[a, 0] * sums[0, b] + t[a, 1] * sums[1, b] + t[a, 2] * sums[2, b] + t[a, 3] * sums[3, b]
            )
    for a in range(4):
        for b in range(3):
            out[a, b] = (
                t[b, 0] * half[a, 0] + t[b, 1] * half[a, 1] + t[b, 2] * half[a, 2] + t[b, 3] * half[a, 3]
            )
        for b in range(3, 7):
            out[a, b] = half[a, b]


@numba.njit(cache=True, nogil=True, inline="always")
def add_wrench(moments: Array, metric: Array, column: int, out: Array) -> None:
    """Add the wrench of forces G f, from the sums (3, 4) of f [x; 1]^T and G (3, 3), to a column of out."""
    g, m = metric, moments
    out[0, column] += force(g, m, 2, 1) - force(g, m, 1, 2)
    out[1, column] += force(g, m, 0, 2) - force(g, m, 2, 0)
    out[2, column] += force(g, m, 1, 0) - force(g, m, 0, 1)
    for a in range(3):
        out[3 + a, column] += force(g, m, a, 3)


@numba.njit(cache=True, nogil=True, inline="always")
def force(metric: Array, moments: Array, a: int, b: int) -> float:
    """Entry (a, b) of the product of a metric (3, 3) and moments (3, 4)."""
    total: float = metric[a, 0] * moments[0, b] + metric[a, 1] * moments[1, b] + metric[a, 2] * moments[2, b]
    return total


@numba.njit(cache=True, nogil=True)
def metric_of(turn: Array, stretch: float) -> Array:
    """The metric (3, 3), in the rig's frame, of a camera that the rotation `turn` leads to."""
    metric = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            along = stretch * stretch * turn[2, a] * turn[2, b]
            metric[a, b] = turn[0, a] * turn[0, b] + turn[1, a] * turn[1, b] + along
    return metric
