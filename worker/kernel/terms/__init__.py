"""The terms of the log posterior: it is minus the sum of their costs, in nats.

Each term is a module with two functions side by side: `cost`, and `linearise`, which adds its gradient and
its Gauss-Newton matrix to the equations. Terms of points are computed from a `CameraView`, the body posed
before a camera. They add to each link a wrench and a matrix (`equations.links`, see `normal_equations`) or,
with the metric of the camera's noise, targets to visible vertices (`workspace.targets`, see `link_sums`), for
which all Gauss-Newton iterations are exact. Terms of the pose add to the degrees of freedom directly.

A term of points with the weight 0 is left out (`parameters.Weights`).
"""

from __future__ import annotations

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.worker.kernel.terms import depth, free_space, keypoints, limits, prior, soft
from gepf.worker.kernel.workspace import CameraView, Equations, Problem


@numba.njit(cache=True, nogil=True)
def cost_of_points(view: CameraView) -> float:
    """Sum of the costs of what a camera observed."""
    total: float = depth.cost(view) + free_space.cost(view) + soft.cost(view)
    total += keypoints.cost(view)
    return total


@numba.njit(cache=True, nogil=True)
def linearise_points(view: CameraView) -> None:
    """Add the equations of what a camera observed."""
    depth.linearise(view)
    free_space.linearise(view)
    soft.linearise(view)
    keypoints.linearise(view)


@numba.njit(cache=True, nogil=True)
def cost_of_pose(pose: Array, mean: Array, problem: Problem) -> float:
    """Sum of the costs of pose (D,) by itself; `mean` (D,) is that of its prior."""
    total: float = limits.cost(pose, mean, problem) + prior.cost(pose, mean, problem)
    return total


@numba.njit(cache=True, nogil=True)
def linearise_pose(pose: Array, mean: Array, problem: Problem, equations: Equations) -> None:
    """Add the equations of pose (D,) by itself."""
    limits.linearise(pose, mean, problem, equations)
    prior.linearise(pose, mean, problem, equations)
