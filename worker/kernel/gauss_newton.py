"""Steps to the pose that minimises the terms at fixed correspondences (step 4d), and its covariance.

Damped Gauss-Newton, Eq. 3-5. The covariance is the inverse of the Gauss-Newton matrix of the log posterior
(Laplace) in the last step, with its closest points, weights and visible points. Damping and joint limits
are not included. Undetermined degrees of freedom, like the twist of a forearm, have a weak prior; without any
step this prior is the covariance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices
from gepf.common.body import SHAPE, TRANSLATION
from gepf.common.compiling import numba
from gepf.common.kinematics.manifold import apply_step, clamp_to_limits, step_between
from gepf.common.refinement import WEAK_SHAPE, WEAK_SLIDE, WEAK_TURN
from gepf.worker.kernel.normal_equations import fill_normal_equations, move_wrenches
from gepf.worker.kernel.parameters import Solver
from gepf.worker.kernel.surface import Skeleton
from gepf.worker.kernel.visibility import move_links
from gepf.worker.kernel.workspace import Equations, Problem, Workspace

SINGULAR = 1e-13  # of the largest entry on the diagonal
CONVERGED = 1e-4  # radians and metres; a smaller step ends the loop


@numba.njit(cache=True, nogil=True)
def minimise(pose: Array, mean: Array, solver: Solver, problem: Problem, workspace: Workspace) -> None:
    """Move pose (D,) in place towards the minimum of Eq. 3 within limits: damped Gauss-Newton (Eq. 4).

    The workspace holds .of_rig at this pose, and the equations of the terms of points, linearised there.
    `mean` (D,) is that of the prior.
    """
    skeleton, equations = problem.skeleton, workspace.equations
    before, linearised = pose.copy(), np.any(equations.links != 0.0)
    for k in range(solver.iterations):
        if k > 0:
            if linearised:
                move_wrenches(skeleton, step_between(skeleton.axes, skeleton.balls, before, pose), equations)
            move_links(pose, skeleton, workspace)
        before[:] = pose
        fill_normal_equations(pose, mean, problem, workspace)
        step = solve(pose, solver.damping, problem, equations)
        size = np.max(np.abs(step))
        if size > solver.longest:
            step *= solver.longest / size
        apply_step(skeleton.axes, skeleton.balls, step, pose)
        clamp_to_limits(skeleton.single, skeleton.limits, pose)
        if size < CONVERGED:
            break


@numba.njit(cache=True, nogil=True)
def solve(pose: Array, damping: float, problem: Problem, equations: Equations) -> Array:
    """The step (D,) that solves the equations (Eq. 4), which are overwritten, within limits."""
    gram, gradient = equations.gram, equations.gradient
    equations.information[:] = gram
    for j in range(len(pose)):
        gram[j, j] += damping
    hold_active_limits(problem.skeleton, pose, gram, gradient)
    step = -gradient
    solve_ltl(problem.elimination, gram, step)
    return step


@numba.njit(cache=True, nogil=True)
def hold_active_limits(skeleton: Skeleton, pose: Array, gram: Array, gradient: Array) -> None:
    """Remove single axes at a limit from the equations if the gradient leads beyond it (active set)."""
    limits, single = skeleton.limits, skeleton.single
    for j in range(len(pose)):
        low = pose[j] <= limits[j, 0] and gradient[j] > 0.0
        high = pose[j] >= limits[j, 1] and gradient[j] < 0.0
        if single[j] and (low or high):
            stiffness = gram[j, j]
            gram[j, :] = 0.0
            gram[:, j] = 0.0
            gram[j, j] = stiffness
            gradient[j] = 0.0


@numba.njit(cache=True, nogil=True)
def over_relax(skeleton: Skeleton, before: Array, pose: Array) -> None:
    """Repeat the motion from `before` to pose (D,) in place, within limits."""
    step = step_between(skeleton.axes, skeleton.balls, before, pose)
    apply_step(skeleton.axes, skeleton.balls, step, pose)
    clamp_to_limits(skeleton.single, skeleton.limits, pose)


@numba.njit(cache=True, nogil=True)
def solve_ltl(parents: Indices, gram: Array, step: Array) -> None:
    """Solve gram (D, D) x = step (D,) in place; gram is overwritten. Undetermined entries become zero."""
    factorise_ltl(parents, gram)
    for k in range(len(parents) - 1, -1, -1):
        step[k] /= gram[k, k]
        i = parents[k]
        while i >= 0:
            step[i] -= gram[k, i] * step[k]
            i = parents[i]
    for k in range(len(parents)):
        i = parents[k]
        while i >= 0:
            step[k] -= gram[k, i] * step[i]
            i = parents[i]
        step[k] /= gram[k, k]


@numba.njit(cache=True, nogil=True)
def factorise_ltl(parents: Indices, gram: Array) -> None:
    """Factorise gram (D, D) in place into L, on and below the diagonal: a branch-sparse factorisation.

    `parents` is the elimination tree. Without a dense prior it is the body's: degrees of freedom on different
    branches move no common link. So their entries are zero, and stay zero in gram = L^T L with L lower
    triangular, which is computed from the tips to the root along the ancestors of each (Featherstone, Rigid
    Body Dynamics Algorithms, section 6.5). If gram is singular, the diagonal is infinite and the rest of the
    row is zero.
    """
    least = SINGULAR * np.max(np.diag(gram))
    for k in range(len(parents) - 1, -1, -1):
        gram[k, k] = np.sqrt(gram[k, k]) if gram[k, k] > least else np.inf
        i = parents[k]
        while i >= 0:
            gram[k, i] /= gram[k, k]
            i = parents[i]
        i = parents[k]
        while i >= 0:
            j = i
            while j >= 0:
                gram[i, j] -= gram[k, i] * gram[k, j]
                j = parents[j]
            i = parents[i]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_covariance_root(problem: Problem, equations: Equations, triangle: NDArray[np.float32]) -> None:
    """Fill a triangle (D (D + 1) / 2,) with the Cholesky factor of the pose's covariance, by rows.

    With its information L^T L the factor is K = L^-1, because K K^T is the inverse.
    """
    skeleton, parents, root = problem.skeleton, problem.elimination, equations.gram
    for k in range(len(parents)):
        for j in range(k + 1):
            root[k, j] = equations.information[k, j]
        root[k, k] += prior_deviation(skeleton.kinds[k]) ** -2.0
    factorise_ltl(parents, root)
    invert_lower(parents, root)
    place = 0
    for i in range(len(parents)):
        widest, row = prior_deviation(skeleton.kinds[i]), root[i, : i + 1]
        is_determined = np.float32(row[i]) > 0.0 and np.sum(row * row) <= (1.01 * widest) ** 2
        if not is_determined:  # rounding of extreme numbers may give invalid values
            row[:] = 0.0
            row[i] = widest
        triangle[place : place + i + 1] = row
        place += i + 1


@numba.njit(cache=True, nogil=True)
def prior_deviation(kind: int) -> float:
    """Standard deviation of the weak prior: that of an undetermined degree of freedom."""
    if kind == SHAPE:
        return WEAK_SHAPE
    return WEAK_SLIDE if kind == TRANSLATION else WEAK_TURN


@numba.njit(cache=True, nogil=True, error_model="numpy")
def invert_lower(parents: Indices, lower: Array) -> None:
    """Invert a lower triangular matrix (D, D) in place; each row is nonzero only at its ancestors.

    The inner loop runs from the diagonal to the left. The entries of row k that it reads are not inverted
    yet; the rows above are.
    """
    for k in range(len(parents)):
        lower[k, k] = 1.0 / lower[k, k]
        for j in range(k):
            total, i = 0.0, parents[k]
            while i >= j:
                total += lower[k, i] * lower[i, j]
                i = parents[i]
            lower[k, j] = -lower[k, k] * total
