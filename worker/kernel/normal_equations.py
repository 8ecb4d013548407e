"""The normal equations (Eq. 3-5) of all terms and cameras, from one wrench and one matrix per link.

The terms of points give each link the gradient of their cost with respect to its twist, which is a
wrench, and the Gauss-Newton matrix (6, 6). Both are in the rig's frame: a twist is (w, v), with the velocity
w x x + v of a point x; a wrench is the torque about the rig's origin, and the force. A degree of freedom j
moves all links after it with a twist t_j. For a rotation about the axis w_j through q_j it is
(w_j, q_j x w_j) (Eq. 2). So

    gradient_j = t_j . (sum of the wrenches of the links that j moves),
    gram_jk = t_j . (sum of the matrices of the links that both move) t_k,

as in the composite rigid body algorithm (Featherstone, Rigid Body Dynamics Algorithms, section 6.2).

Shape coefficients (S) move the points of every link (`shape`). So a link's wrench has S more entries, the
derivatives by the coefficients, its matrix as many more rows and columns, and the twist of a coefficient is a
unit vector among them.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import SHAPE, TRANSLATION
from gepf.common.compiling import numba
from gepf.common.kinematics.chain import motion_axes
from gepf.worker.kernel import terms
from gepf.worker.kernel.link_sums import add_link, metric_of
from gepf.worker.kernel.shape import fill_drifts, place_fields
from gepf.worker.kernel.surface import Skeleton
from gepf.worker.kernel.workspace import Equations, Problem, Workspace


@numba.njit(cache=True, nogil=True)
def fill_normal_equations(pose: Array, mean: Array, problem: Problem, workspace: Workspace) -> None:
    """Fill the lower part of gram (D, D), and gradient (D,), with those of all terms at pose (D,).

    The workspace holds the links in this pose, and the terms of points in equations.links and .sums. mean
    (D,) is that of the prior.
    """
    skeleton, equations = problem.skeleton, workspace.equations
    gram, gradient, parents = equations.gram, equations.gradient, skeleton.parents
    fill_twists(skeleton, workspace)
    sum_subtrees(problem, workspace)
    subtrees, twists, force = equations.subtrees, equations.twists, np.empty(equations.twists.shape[1])
    gram[:, :], gradient[:] = 0.0, 0.0
    for k in range(len(gradient)):
        first, stop = entries_of(k, skeleton)
        force[:] = 0.0
        for b in range(first, stop):
            gradient[k] += twists[k, b] * subtrees[k, b, len(force)]
            for a in range(len(force)):
                force[a] += subtrees[k, b, a] * twists[k, b]  # matrices are symmetric
        j = k
        while j >= 0:  # only ancestors share moved links
            first, stop = entries_of(j, skeleton)
            for a in range(first, stop):
                gram[k, j] += force[a] * twists[j, a]
            j = parents[j]
    terms.linearise_pose(pose, mean, problem, equations)


@numba.njit(cache=True, nogil=True, inline="always")
def entries_of(j: int, skeleton: Skeleton) -> tuple[int, int]:
    """The entries of the twist of degree of freedom j that may be nonzero: the first, and the end."""
    return (6 + j, 7 + j) if skeleton.kinds[j] == SHAPE else (0, 6)


@numba.njit(cache=True, nogil=True)
def fill_twists(skeleton: Skeleton, workspace: Workspace) -> None:
    """Fill the twists (D, 6 + S) of all degrees of freedom: w, v, shape; w is zero for a translation."""
    twists, transforms = workspace.equations.twists, workspace.of_rig
    w, q = np.empty((len(skeleton.parents), 3)), np.empty((len(skeleton.parents), 3))
    motion_axes(skeleton.parents, skeleton.axes, workspace.points, skeleton.balls, transforms, w, q)
    for j in range(len(w)):
        if skeleton.kinds[j] == SHAPE:
            twists[j, 6 + j] = 1.0
        elif skeleton.kinds[j] == TRANSLATION:
            twists[j, :3], twists[j, 3:6] = 0.0, w[j]
        else:
            twists[j, :3] = w[j]
            twists[j, 3] = q[j, 1] * w[j, 2] - q[j, 2] * w[j, 1]
            twists[j, 4] = q[j, 2] * w[j, 0] - q[j, 0] * w[j, 2]
            twists[j, 5] = q[j, 0] * w[j, 1] - q[j, 1] * w[j, 0]


@numba.njit(cache=True, nogil=True)
def sum_subtrees(problem: Problem, workspace: Workspace) -> None:
    """Fill equations.subtrees: for each degree of freedom, the matrices and wrenches of its links, summed."""
    skeleton, equations, of_rig = problem.skeleton, workspace.equations, workspace.of_rig
    parents, link_dofs, of_links = skeleton.parents, skeleton.link_dofs, workspace.of_links
    subtrees, links, drifts = equations.subtrees, equations.links, equations.drifts
    at_rest, fields, scratch = skeleton.shape_fields, equations.fields, equations.scratch
    fill_drifts(skeleton.kinds, parents, skeleton.shape_points, of_rig, drifts)
    subtrees[:] = 0.0
    for s in range(len(link_dofs)):
        if link_dofs[s] >= 0:
            add_entries(links[s], subtrees[link_dofs[s]])
    for v in range(len(equations.sums)):
        of_camera, metric = equations.sums[v], metric_of(equations.turns[v], problem.parameters.stretch)
        for s in range(len(link_dofs)):
            j = link_dofs[s]
            if j >= 0 and of_camera[s, 3, 3] > 0.0:
                place_fields(of_rig[j], at_rest[s], drifts[j], fields)
                add_link(of_links[s], of_camera[s], metric, fields, scratch, subtrees[j])
    for j in range(len(parents) - 1, 0, -1):
        if parents[j] >= 0:
            add_entries(subtrees[j], subtrees[parents[j]])


@numba.njit(cache=True, nogil=True)
def add_entries(matrix: Array, out: Array) -> None:
    """Add a matrix to out; numpy's += on a part of an array takes longer."""
    for a in range(matrix.shape[0]):
        for b in range(matrix.shape[1]):
            out[a, b] += matrix[a, b]


@numba.njit(cache=True, nogil=True)
def move_wrenches(skeleton: Skeleton, step: Array, equations: Equations) -> None:
    """Change the wrenches of equations.links by a step (D,) of the pose, to first order."""
    moved, links = np.zeros_like(equations.twists), equations.links
    for j in range(len(moved)):
        if skeleton.parents[j] >= 0:
            moved[j] = moved[skeleton.parents[j]]
        moved[j] += step[j] * equations.twists[j]
    for s in range(len(skeleton.link_dofs)):
        j = skeleton.link_dofs[s]
        if j >= 0:
            for a in range(moved.shape[1]):
                for b in range(moved.shape[1]):
                    links[s, a, -1] += links[s, a, b] * moved[j, b]
