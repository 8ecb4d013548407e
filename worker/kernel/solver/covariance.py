"""How sure a refined pose is: the inverse of the log posterior's Gauss-Newton matrix (Laplace).

The matrix is that of the descent's last step, with closest points, weights and what is visible as they were
there. Damping is not in it. A joint at its limit is as sure as the points say, as if it could go on. What
nothing determines, as the twist of a forearm, is held by a weak prior; without a descent that is all.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.refinement import WEAK_SLIDE, WEAK_TURN
from worker.kernel.packing import KernelParameters
from worker.kernel.solver.gauss_newton import factorise_ltl
from worker.kernel.solver.normal_equations import NormalEquations
from worker.kernel.surface import Skeleton

Array = NDArray[np.float64]


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
