"""The pose that minimises the distances of given correspondences (step 4d), and its covariance.

Damped Gauss-Newton, Eq. 3-5. The covariance is the inverse of the Gauss-Newton matrix of the log posterior
(Laplace) in the last step, with its closest points, weights and visible points. Damping and joint limits are
not included. Undetermined degrees of freedom, like the twist of a forearm, have a weak prior; without any
step this prior is the covariance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices
from gepf.common.compiling import numba
from gepf.common.kinematics.chain import forward_kinematics
from gepf.common.kinematics.manifold import apply_step, clamp_to_limits, step_between
from gepf.common.refinement import WEAK_SLIDE, WEAK_TURN
from gepf.worker.kernel.normal_equations import fill_normal_equations
from gepf.worker.kernel.parameters import KernelParameters
from gepf.worker.kernel.priors import add_prior, hold_active_limits
from gepf.worker.kernel.surface import Skeleton
from gepf.worker.kernel.workspace import Equations

SINGULAR = 1e-13  # of the largest entry on the diagonal
CONVERGED = 1e-4  # radians and metres; a smaller step ends the loop


@numba.njit(cache=True, nogil=True)
def minimise(
    skeleton: Skeleton,
    pose: Array,
    transforms: Array,
    points: int,
    parameters: KernelParameters,
    equations: Equations,
) -> None:
    """Move pose (D,) in place to the minimum of Eq. 3 for `points` points by damped Gauss-Newton (Eq. 4).

    equations.sums hold the correspondences; transforms (D + 1, 3, 4) are T_rig_rest at the given pose, and
    after that those of the last step.
    """
    damping = parameters.damping + parameters.steps.damping_share * points
    for k in range(parameters.steps.gauss_newton_iterations):
        if k > 0:
            forward_kinematics(
                skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, transforms
            )
        fill_normal_equations(skeleton, transforms, parameters.stretch, equations)
        add_prior(skeleton, pose, parameters.rest_weight, points, equations.gram, equations.gradient)
        step = take_step(skeleton, pose, damping, np.inf, equations)
        if np.max(np.abs(step)) < CONVERGED:
            break


@numba.njit(cache=True, nogil=True)
def take_step(skeleton: Skeleton, pose: Array, damping: float, longest: float, equations: Equations) -> Array:
    """Solve the equations (Eq. 4) in place and move pose (D,), within limits; returns the step (D,).

    No entry of the step, in radians or metres, is larger than `longest`.
    """
    gram, gradient = equations.gram, equations.gradient
    equations.information[:] = gram
    for j in range(len(pose)):
        gram[j, j] += damping
    hold_active_limits(skeleton, pose, gram, gradient)
    step = -gradient
    solve_ltl(skeleton.parents, gram, step)
    size = np.max(np.abs(step))
    if size > longest:
        step *= longest / size
    apply_step(skeleton.axes, skeleton.balls, step, pose)
    clamp_to_limits(skeleton.single, skeleton.limits, pose)
    return step


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

    Degrees of freedom on different branches move no common link. So their entries are zero, and stay zero in
    gram = L^T L with L lower triangular, which is computed from the tips to the root along the ancestors of
    each (Featherstone, Rigid Body Dynamics Algorithms, section 6.5). If gram is singular, the diagonal is
    infinite and the rest of the row is zero.
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
def fill_covariance_root(
    skeleton: Skeleton, scale: float, equations: Equations, triangle: NDArray[np.float32]
) -> None:
    """Fill a triangle (D (D + 1) / 2,) with the Cholesky factor of the pose's covariance, by rows.

    `scale` converts the equations to the log posterior. With its information L^T L the factor is K = L^-1,
    because K K^T is the inverse.
    """
    parents, root = skeleton.parents, equations.gram
    for k in range(len(parents)):
        for j in range(k + 1):
            root[k, j] = scale * equations.information[k, j]
        root[k, k] += prior_deviation(skeleton.kinds[k]) ** -2.0
    factorise_ltl(parents, root)
    invert_lower(parents, root)
    place = 0
    for i in range(len(parents)):
        widest, row = prior_deviation(skeleton.kinds[i]), root[i, : i + 1]
        known = np.float32(row[i]) > 0.0 and np.sum(row * row) <= (1.01 * widest) ** 2
        if not known:  # rounding of extreme numbers may give invalid values
            row[:] = 0.0
            row[i] = widest
        triangle[place : place + i + 1] = row
        place += i + 1


@numba.njit(cache=True, nogil=True)
def prior_deviation(kind: int) -> float:
    """Standard deviation of the weak prior: that of an undetermined degree of freedom."""
    return WEAK_SLIDE if kind == 0 else WEAK_TURN


@numba.njit(cache=True, nogil=True, error_model="numpy")
def invert_lower(parents: Indices, lower: Array) -> None:
    """Invert a lower triangular matrix (D, D) in place; each row is nonzero only at its ancestors.

    It proceeds from the diagonal to the left, where the row is not inverted yet; the rows above are inverted.
    """
    for k in range(len(parents)):
        lower[k, k] = 1.0 / lower[k, k]
        for j in range(k):
            total, i = 0.0, parents[k]
            while i >= j:
                total += lower[k, i] * lower[i, j]
                i = parents[i]
            lower[k, j] = -lower[k, k] * total
