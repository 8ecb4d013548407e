"""The normal equations (Eq. 3-5) of all terms and cameras, from one wrench and one matrix per link.

The terms of points leave to each link the gradient of their cost with respect to its twist, which is a
wrench, and the Gauss-Newton matrix (6, 6). Both are in the rig's frame: a twist is (w, v), with the velocity
w x x + v of a point x; a wrench is the torque about the rig's origin, and the force. A degree of freedom j
moves all links after it with a twist t_j. It is (w_j, q_j x w_j) of a rotation about the axis w_j through q_j
(Eq. 2). So

    gradient_j = t_j . (sum of the wrenches of the links that j moves),
    gram_jk = t_j . (sum of the matrices of the links that both move) t_k,

as in the composite rigid body algorithm (Featherstone, Rigid Body Dynamics Algorithms, section 6.2).
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import TRANSLATION
from gepf.common.compiling import numba
from gepf.common.kinematics.chain import motion_axes
from gepf.worker.kernel import terms
from gepf.worker.kernel.link_sums import add_wrenches, metric_of
from gepf.worker.kernel.surface import Skeleton
from gepf.worker.kernel.workspace import Equations, Problem


@numba.njit(cache=True, nogil=True)
def fill_normal_equations(
    pose: Array, mean: Array, transforms: Array, problem: Problem, equations: Equations
) -> None:
    """Fill the lower part of gram (D, D), and gradient (D,), with those of all terms at pose (D,).

    transforms (D + 1, 3, 4) are T_rig_rest; equations.links and .sums hold the terms of points, mean (D,) is
    that of the prior.
    """
    skeleton = problem.skeleton
    gram, gradient, parents = equations.gram, equations.gradient, skeleton.parents
    fill_twists(skeleton, transforms, equations.twists)
    subtrees, twists = sum_subtrees(transforms, problem, equations), equations.twists
    gram[:, :], gradient[:] = 0.0, 0.0
    force = np.empty(6)
    for k in range(len(gradient)):
        for a in range(6):
            gradient[k] += twists[k, a] * subtrees[k, a, 6]
            force[a] = product(subtrees[k, a], twists[k])
        j = k
        while j >= 0:  # only ancestors share moved links
            gram[k, j] += product(force, twists[j])
            j = parents[j]
    terms.linearise_pose(pose, mean, problem, equations)


@numba.njit(cache=True, nogil=True, inline="always")
def product(one: Array, other: Array) -> float:
    """The scalar product of the first six entries of both."""
    turning: float = one[0] * other[0] + one[1] * other[1] + one[2] * other[2]
    moving: float = one[3] * other[3] + one[4] * other[4] + one[5] * other[5]
    return turning + moving


@numba.njit(cache=True, nogil=True)
def fill_twists(skeleton: Skeleton, transforms: Array, twists: Array) -> None:
    """Fill twists (D, 6) of all degrees of freedom: w, v; w is zero for a translation."""
    w, q = np.empty((len(skeleton.parents), 3)), np.empty((len(skeleton.parents), 3))
    motion_axes(skeleton.parents, skeleton.axes, skeleton.points, skeleton.balls, transforms, w, q)
    for j in range(len(w)):
        if skeleton.kinds[j] == TRANSLATION:
            twists[j, :3], twists[j, 3:] = 0.0, w[j]
        else:
            twists[j, :3] = w[j]
            twists[j, 3] = q[j, 1] * w[j, 2] - q[j, 2] * w[j, 1]
            twists[j, 4] = q[j, 2] * w[j, 0] - q[j, 0] * w[j, 2]
            twists[j, 5] = q[j, 0] * w[j, 1] - q[j, 1] * w[j, 0]


@numba.njit(cache=True, nogil=True)
def sum_subtrees(transforms: Array, problem: Problem, equations: Equations) -> Array:
    """Matrices and wrenches (D, 6, 7), summed over the links that each degree of freedom moves."""
    parents, link_dofs = problem.skeleton.parents, problem.skeleton.link_dofs
    subtrees, scratch = np.zeros((len(parents), 6, 7)), np.empty((3, 4, 8))
    for s in range(len(link_dofs)):
        if link_dofs[s] >= 0:
            subtrees[link_dofs[s]] += equations.links[s]
    for v in range(len(equations.sums)):
        metric = metric_of(equations.turns[v], problem.parameters.stretch)
        for s in range(len(link_dofs)):
            sums, j = equations.sums[v, s], link_dofs[s]
            if j >= 0 and sums[3, 3] > 0.0:
                add_wrenches(transforms[j], sums, metric, scratch, subtrees[j])
    for j in range(len(parents) - 1, 0, -1):
        if parents[j] >= 0:
            subtrees[parents[j]] += subtrees[j]
    return subtrees


@numba.njit(cache=True, nogil=True)
def move_wrenches(skeleton: Skeleton, step: Array, equations: Equations) -> None:
    """Change the wrenches of equations.links by a step (D,) of the pose, to first order."""
    moved = np.zeros((len(skeleton.parents), 6))
    for j in range(len(moved)):
        if skeleton.parents[j] >= 0:
            moved[j] = moved[skeleton.parents[j]]
        moved[j] += step[j] * equations.twists[j]
    for s in range(len(skeleton.link_dofs)):
        j = skeleton.link_dofs[s]
        if j >= 0:
            for a in range(6):
                equations.links[s, a, 6] += product(equations.links[s, a], moved[j])
