"""Limits of spherical joints: half the stiffness times the squared excess of their angles.

Single axes never leave their limits; see `hold_active_limits` in `gauss_newton`.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba
from gepf.common.kinematics.rotations import handedness
from gepf.worker.kernel.surface import Skeleton
from gepf.worker.kernel.workspace import Equations, Problem


@numba.njit(cache=True, nogil=True)
def cost(pose: Array, mean: Array, problem: Problem) -> float:  # noqa: ARG001 as of all terms
    """Cost of pose (D,)."""
    skeleton, excess, total = problem.skeleton, np.empty(3), 0.0
    for start in skeleton.balls:
        if fill_excess(skeleton, pose, start, excess):
            total += excess[0] ** 2 + excess[1] ** 2 + excess[2] ** 2
    return 0.5 * problem.parameters.limit_stiffness * total


@numba.njit(cache=True, nogil=True)
def linearise(
    pose: Array,
    mean: Array,  # noqa: ARG001 as of all terms
    problem: Problem,
    equations: Equations,
) -> None:
    """Add the derivatives at pose (D,) to gram and gradient.

    With R = R_1 R_2 R_3 a small rotation d of a spherical joint along its axes changes its angles by E^-1 d,
    E = [a_1, R_1 a_2, R_1 R_2 a_3].
    """
    skeleton, gram, gradient = problem.skeleton, equations.gram, equations.gradient
    excess = np.empty(3)
    for start in skeleton.balls:
        if fill_excess(skeleton, pose, start, excess):
            handed = handedness(skeleton.axes, start)
            sa, ca = np.sin(handed * pose[start]), np.cos(pose[start])
            sb, cb = np.sin(handed * pose[start + 1]), np.cos(pose[start + 1])
            rates = np.array(((1.0, sa * sb / cb, -ca * sb / cb), (0.0, ca, sa), (0.0, -sa / cb, ca / cb)))
            for a in range(3):
                if excess[a] != 0.0:
                    for b in range(3):
                        stiffness = problem.parameters.limit_stiffness * rates[a, b]
                        gradient[start + b] += stiffness * excess[a]
                        for c in range(3):
                            gram[start + b, start + c] += stiffness * rates[a, c]


@numba.njit(cache=True, nogil=True)
def fill_excess(skeleton: Skeleton, pose: Array, start: int, excess: Array) -> bool:
    """Fill excess (3,) of a spherical joint's angles over their limits; returns whether any is to be used.

    If the middle angle is near 90 degrees, the other angles are arbitrary, and no excess is to be used.
    """
    outside = False
    for a in range(3):
        angle, low, high = pose[start + a], skeleton.limits[start + a, 0], skeleton.limits[start + a, 1]
        excess[a] = angle - min(max(angle, low), high)
        outside = outside or excess[a] != 0.0
    return outside and abs(np.cos(pose[start + 1])) > 0.3
