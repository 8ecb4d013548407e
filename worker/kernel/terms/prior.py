"""The Gaussian prior of the pose: half the squared Mahalanobis distance from its mean.

The distance is in relative motion (`step_between`). Precisions are multiplied along the ancestors in the
elimination tree of the request, where all nonzero entries are.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.common.kinematics.manifold import step_between
from gepf.common.kinematics.rotations import handedness
from gepf.worker.kernel.workspace import Equations, Problem

Vector = tuple[float, float, float]


@numba.njit(cache=True, nogil=True)
def cost(pose: Array, mean: Array, problem: Problem) -> float:
    """Cost of pose (D,) for a mean (D,)."""
    if len(problem.precision) == 0:
        return 0.0
    away = step_between(problem.skeleton.axes, problem.skeleton.balls, mean, pose)
    return 0.5 * float(np.sum(away * weighted(away, problem)))


@numba.njit(cache=True, nogil=True)
def linearise(pose: Array, mean: Array, problem: Problem, equations: Equations) -> None:
    """Add the derivatives at pose (D,) for a mean (D,) to gram and gradient.

    A small rotation d after the rotation vector a of a spherical joint makes it a + J^-1 d, with
    J^-T = 1 + 1/2 [a] + c [a]^2 and c = (1 - |a| / 2 cot(|a| / 2)) / |a|^2. In gram J is 1.
    """
    skeleton, gram, gradient = problem.skeleton, equations.gram, equations.gradient
    if len(problem.precision) == 0:
        return
    away = step_between(skeleton.axes, skeleton.balls, mean, pose)
    pull = weighted(away, problem)
    for start in skeleton.balls:
        x, y, z = away[start], away[start + 1], away[start + 2]
        once = cross((x, y, z), (pull[start], pull[start + 1], pull[start + 2]))
        twice, half = cross((x, y, z), once), 0.5 * np.sqrt(x * x + y * y + z * z)
        curvature = 1.0 / 12.0 if half < 1e-3 else 0.25 * (1.0 - half / np.tan(half)) / half**2
        turning = 0.5 * handedness(skeleton.axes, start)
        for a in range(3):
            pull[start + a] += turning * once[a] + curvature * twice[a]
    for k in range(len(pose)):
        gradient[k] += pull[k]
        j = k
        while j >= 0:
            gram[k, j] += problem.precision[k, j]
            j = problem.elimination[j]


@numba.njit(cache=True, nogil=True)
def weighted(away: Array, problem: Problem) -> Array:
    """The product of precision (D, D) and a step (D,)."""
    product, precision = np.zeros_like(away), problem.precision
    for k in range(len(away)):
        product[k] += precision[k, k] * away[k]
        j = problem.elimination[k]
        while j >= 0:
            product[k] += precision[k, j] * away[j]
            product[j] += precision[k, j] * away[k]
            j = problem.elimination[j]
    return product


@numba.njit(cache=True, nogil=True, inline="always")
def cross(a: Vector, b: Vector) -> Vector:
    """The vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
