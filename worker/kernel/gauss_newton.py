"""The pose that minimises the distances of given correspondences (step 4d), and how sure it is.

Damped Gauss-Newton, Eq. 3-5. The covariance is the inverse of the log posterior's Gauss-Newton matrix
(Laplace): that of the last step, with closest points, weights and what is visible as they were there. Damping
is not in it. A joint at its limit is as sure as the points say, as if it could go on. What nothing
determines, as the twist of a forearm, is held by a weak prior; without any step that is all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.kinematics.chain import forward_kinematics
from common.kinematics.manifold import apply_step, ball_vector, clamp_to_limits
from common.kinematics.rotations import handedness
from common.refinement import WEAK_SLIDE, WEAK_TURN
from worker.kernel.normal_equations import normal_equations, subtree_moments
from worker.kernel.parameters import KernelParameters
from worker.kernel.priors import add_limit_prior, add_rest_prior, hold_active_limits
from worker.kernel.surface import Skeleton
from worker.kernel.workspace import NormalEquations

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SINGULAR = 1e-13  # of the largest entry on the diagonal
CONVERGED = 1e-4  # radians and metres: a step below it ends the loop


class SolverParameters(NamedTuple):
    """Parameters of the Gauss-Newton steps."""

    metric: Array  # (3,) weights of the camera's axes
    damping: float  # lambda of Eq. 4
    stiffness: float  # of the rest prior: weight of a squared joint angle
    limit_stiffness: float  # and of a squared radian beyond a ball's limits
    iterations: int


@numba.njit(cache=True, nogil=True)
def minimise(
    skeleton: Skeleton, pose: Array, transforms: Array, solver: SolverParameters, equations: NormalEquations
) -> None:
    """Move pose (D,) in place to the minimum of Eq. 3 by damped Gauss-Newton steps (Eq. 4).

    The equations' moments and crosses are in the camera frame at the pose given, where transforms
    (D + 1, 3, 4) are T_camera_rest.
    """
    reference, moved, step = equations.reference, equations.moved, equations.step
    reference[:] = moved[:] = transforms[:-1]
    for k in range(solver.iterations):
        if k > 0:
            forward_kinematics(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, moved)
        fill_equations(skeleton, pose, solver, equations)
        equations.information[:] = equations.gram
        for j in range(len(pose)):
            equations.gram[j, j] += solver.damping
        hold_active_limits(skeleton, pose, equations.gram, equations.gradient)
        step[:] = -equations.gradient
        solve_ltl(skeleton.parents, equations.gram, step)  # Eq. 4
        apply_step(skeleton.axes, skeleton.balls, step, pose)
        clamp_to_limits(skeleton.single, skeleton.limits, pose)
        if np.max(np.abs(step)) < CONVERGED:
            break


@numba.njit(cache=True, nogil=True)
def fill_equations(
    skeleton: Skeleton, pose: Array, solver: SolverParameters, equations: NormalEquations
) -> None:
    """Fill equations.gram and .gradient at pose (D,), to which the body has moved since the sums were taken.

    There equations.moved is T_camera_rest. Where they were taken the gradient is that of half the posterior's
    cost, of as many points as there are.
    """
    subtree_moments(skeleton, equations)
    normal_equations(skeleton, solver.metric, equations)
    if solver.stiffness > 0.0:
        add_rest_prior(skeleton, pose, solver.stiffness, equations.gram, equations.gradient)
    add_limit_prior(skeleton, pose, solver.limit_stiffness, equations.gram, equations.gradient)


@numba.njit(cache=True, nogil=True)
def over_relax(skeleton: Skeleton, before: Array, share: float, pose: Array) -> None:
    """Over-relax: move pose (D,) on in place by a share of the motion that led there from `before`."""
    step = pose - before
    for start in skeleton.balls:
        handed = handedness(skeleton.axes, start)
        step[start], step[start + 1], step[start + 2] = ball_vector(handed, before, pose, start)
    apply_step(skeleton.axes, skeleton.balls, share * step, pose)


@numba.njit(cache=True, nogil=True)
def solve_ltl(parents: Indices, gram: Array, step: Array) -> None:
    """Solve gram (D, D) x = step (D,) in place; gram is lost. What nothing determines stays where it is."""
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
    """Turn gram (D, D) into L in place, below the diagonal and on it: a branch-sparse factorisation.

    Degrees of freedom that lie on different branches share no moved link, so their entries are zero and stay
    zero in gram = L^T L with L lower triangular, which is found from the tips to the root along the
    ancestors of each (Featherstone, Rigid Body Dynamics Algorithms, section 6.5). Where gram is singular the
    diagonal is infinite, and the row beside it zero.
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
    skeleton: Skeleton,
    points: int,
    parameters: KernelParameters,
    equations: NormalEquations,
    triangle: NDArray[np.float32],
) -> None:
    """Fill a triangle (D (D + 1) / 2,) with the Cholesky factor of the pose's covariance, row after row.

    With the information L^T L that is K = L^-1, as K K^T is its inverse.
    """
    parents, gram = skeleton.parents, equations.gram
    scale = scale_of(parameters, points)
    for k in range(len(parents)):
        for j in range(k + 1):
            gram[k, j] = scale * equations.information[k, j]
        gram[k, k] += 1.0 / prior_deviation(skeleton.kinds[k]) ** 2
    factorise_ltl(parents, gram)
    invert_lower(parents, gram)
    place = 0
    for i in range(len(parents)):
        known = is_known(gram, i, prior_deviation(skeleton.kinds[i]))
        for j in range(i):
            triangle[place + j] = gram[i, j] if known else 0.0
        triangle[place + i] = gram[i, i] if known else prior_deviation(skeleton.kinds[i])
        place += i + 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def scale_of(parameters: KernelParameters, points: int) -> float:
    """What takes equations of so many points to the log posterior."""
    if parameters.soft:
        return parameters.independent_points / (points * parameters.noise_lateral**2)
    return parameters.likelihood_scale / points


@numba.njit(cache=True, nogil=True)
def prior_deviation(kind: int) -> float:
    """Of the weak prior: the standard deviation of a degree of freedom that nothing determines."""
    return WEAK_SLIDE if kind == 0 else WEAK_TURN


@numba.njit(cache=True, nogil=True)
def is_known(root: Array, i: int, most: float) -> bool:
    """Whether row i of a root (D, D) says something: of extreme numbers rounding may leave nonsense."""
    squares = 0.0
    for j in range(i + 1):
        squares += root[i, j] * root[i, j]
    return bool(np.float32(root[i, i]) > 0.0 and squares <= (1.01 * most) ** 2)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def invert_lower(parents: NDArray[np.int64], lower: Array) -> None:
    """Invert a lower triangular matrix (D, D) in place, zero in each row but for the row's ancestors."""
    for k in range(len(parents)):
        lower[k, k] = 1.0 / lower[k, k]
        for j in range(
            k
        ):  # to the right of j the row is still that of the matrix, the rows above are inverted
            total, i = 0.0, parents[k]
            while i >= j:
                total += lower[k, i] * lower[i, j]
                i = parents[i]
            lower[k, j] = -lower[k, k] * total
