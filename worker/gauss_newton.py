"""The pose that minimises the distances of given correspondences (step 4d, Eq. 3-5), without its points.

The model is linear in each link's transform. With X = [p; 1] a model point and p~ the observed point that
belongs to it, the sums M_s = sum w X X^T and C_s = sum w X p~^T of each link s hold all that Eq. 3-5 need:
with A_j = [w_j]x [I | -q_j] for a rotation, column j of the Jacobian is A_j X, so

    (J^T J)_jk = sum_s tr(A_j M_s A_k^T)        (J^T r)_j = sum_s tr(A_j (M_s E - C_s)),  E = [I | 0]^T

over the links s that both (that) degrees of freedom move. A link's relative motion G takes M_s to
G M_s G^T and C_s to G C_s, so a step costs the same for a thousand points as for a million.

A vertex that is blended over several links adds to each of them in proportion to its weights. That leaves
J^T r exact and makes J^T J an upper bound, so steps stay safe.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from common.kinematics import apply_step, carry_axes, chain
from worker.surface import Skeleton

Array = NDArray[np.float64]

CONVERGED = 1e-4  # radians and metres: a step below it ends the loop


@numba.njit(cache=True, nogil=True)
def add_correspondence(
    moments: Array, crosses: Array, point: Array, links: NDArray[np.int64], weights: Array, mass: float,
    target: Array,
) -> None:
    """Add a model point (3,) drawn to observed points of total weight `mass` and weighted sum `target` (3,)."""
    for k in range(len(links)):
        share = weights[k]
        if share > 0.0:
            s = links[k]
            for a in range(4):
                xa = share * (point[a] if a < 3 else 1.0)
                for b in range(3):
                    moments[s, a, b] += mass * xa * point[b]
                    crosses[s, a, b] += xa * target[b]
                moments[s, a, 3] += mass * xa


@numba.njit(cache=True, nogil=True)
def minimise(
    skeleton: Skeleton, pose: Array, moments: Array, crosses: Array, metric: Array, damping: float,
    iterations: int, keep_limits: bool,
) -> None:
    """Move pose (D,) in place to the minimum of Eq. 3 by damped Gauss-Newton steps (Eq. 4).

    moments (L, 4, 4) and crosses (L, 4, 3) are in the camera frame at the pose given; metric (3,) weights
    the camera's axes.
    """
    count = len(pose)
    reference, moved = np.empty((count, 3, 4)), np.empty((count, 3, 4))
    w, q = np.empty((count, 3)), np.empty((count, 3))
    gram, gradient = np.empty((count, count)), np.empty(count)
    chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, reference)
    for _ in range(iterations):
        chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, moved)
        carry_axes(skeleton.parents, skeleton.axes, skeleton.points, skeleton.balls, moved, w, q)
        subtree_m, subtree_c = subtree_moments(skeleton, moments, crosses, reference, moved)
        normal_equations(skeleton, w, q, subtree_m, subtree_c, metric, gram, gradient)
        for j in range(count):
            gram[j, j] += damping
        if keep_limits:
            hold_at_limits(skeleton, pose, gram, gradient)
        step = np.linalg.solve(gram, -gradient)  # Eq. 4
        apply_step(skeleton.axes, skeleton.balls, step, pose)
        if keep_limits:
            clamp(skeleton.limits, pose)
        if np.max(np.abs(step)) < CONVERGED:
            break


@numba.njit(cache=True, nogil=True)
def subtree_moments(
    skeleton: Skeleton, moments: Array, crosses: Array, reference: Array, moved: Array
) -> tuple[Array, Array]:
    """Moments (D, 4, 4) and (D, 4, 3), at the moved pose, of all that each degree of freedom moves."""
    count = len(skeleton.parents)
    subtree_m, subtree_c = np.zeros((count, 4, 4)), np.zeros((count, 4, 3))
    g, half = np.zeros((4, 4)), np.empty((4, 4))
    for s in range(len(skeleton.link_dofs)):
        j = skeleton.link_dofs[s]
        if j < 0 or moments[s, 3, 3] == 0.0:
            continue
        relative_motion(reference[j], moved[j], g)
        multiply(g, moments[s], half)
        for a in range(4):
            for b in range(4):
                for c in range(4):
                    subtree_m[j, a, b] += half[a, c] * g[b, c]
                    if b < 3:
                        subtree_c[j, a, b] += g[a, c] * crosses[s, c, b]
    for j in range(count - 1, 0, -1):
        parent = skeleton.parents[j]
        if parent >= 0:
            subtree_m[parent] += subtree_m[j]
            subtree_c[parent] += subtree_c[j]
    return subtree_m, subtree_c


@numba.njit(cache=True, nogil=True)
def relative_motion(before: Array, after: Array, g: Array) -> None:
    """g (4, 4) = after o before^-1 for rigid transforms (3, 4)."""
    for a in range(3):
        for b in range(3):
            g[a, b] = after[a, 0] * before[b, 0] + after[a, 1] * before[b, 1] + after[a, 2] * before[b, 2]
        g[a, 3] = after[a, 3]
        for b in range(3):
            g[a, 3] -= g[a, b] * before[b, 3]
    g[3, :] = 0.0
    g[3, 3] = 1.0


@numba.njit(cache=True, nogil=True, inline="always")
def multiply(one: Array, other: Array, out: Array) -> None:
    """out = one @ other, (4, 4)."""
    for a in range(4):
        for b in range(4):
            out[a, b] = (
                one[a, 0] * other[0, b] + one[a, 1] * other[1, b] + one[a, 2] * other[2, b] + one[a, 3] * other[3, b]
            )


@numba.njit(cache=True, nogil=True)
def normal_equations(
    skeleton: Skeleton, w: Array, q: Array, subtree_m: Array, subtree_c: Array, metric: Array, gram: Array,
    gradient: Array,
) -> None:
    """Fill gram (D, D) with J^T J and gradient (D,) with J^T r."""
    count = len(skeleton.parents)
    gram[:, :] = 0.0
    columns = np.empty((count, 3, 4))
    product = np.empty((3, 4))
    for j in range(count):
        jacobian_matrix(skeleton.kinds[j], w[j], q[j], columns[j])
    for k in range(count):
        m, c = subtree_m[k], subtree_c[k]
        gradient[k] = 0.0
        for r in range(3):
            for b in range(4):
                product[r, b] = 0.0
                for a in range(4):
                    product[r, b] += columns[k, r, a] * m[a, b]
                gradient[k] += metric[r] * columns[k, r, b] * (m[b, r] - c[b, r])
        j = k
        while j >= 0:  # only ancestors share moved links
            total = 0.0
            for r in range(3):
                for b in range(4):
                    total += metric[r] * product[r, b] * columns[j, r, b]
            gram[j, k] = gram[k, j] = total
            j = skeleton.parents[j]


@numba.njit(cache=True, nogil=True, inline="always")
def jacobian_matrix(kind: int, w: Array, q: Array, out: Array) -> None:
    """A (3, 4) with A [p; 1] = w x (p - q), the derivative of Eq. 2; for a translation, = w."""
    out[:, :] = 0.0
    if kind == 0:
        out[0, 3], out[1, 3], out[2, 3] = w[0], w[1], w[2]
    else:
        out[0, 1], out[0, 2] = -w[2], w[1]
        out[1, 0], out[1, 2] = w[2], -w[0]
        out[2, 0], out[2, 1] = -w[1], w[0]
        out[0, 3] = -(w[1] * q[2] - w[2] * q[1])
        out[1, 3] = -(w[2] * q[0] - w[0] * q[2])
        out[2, 3] = -(w[0] * q[1] - w[1] * q[0])


@numba.njit(cache=True, nogil=True)
def hold_at_limits(skeleton: Skeleton, pose: Array, gram: Array, gradient: Array) -> None:
    """Take out of the equations the single axes that stand at a limit and are pushed further out."""
    single = np.ones(len(pose), dtype=np.bool_)
    for start in skeleton.balls:
        single[start : start + 3] = False
    for j in range(len(pose)):
        low = pose[j] <= skeleton.limits[j, 0] and gradient[j] > 0.0
        high = pose[j] >= skeleton.limits[j, 1] and gradient[j] < 0.0
        if single[j] and (low or high):
            gram[j, :] = 0.0
            gram[:, j] = 0.0
            gram[j, j] = 1.0
            gradient[j] = 0.0


@numba.njit(cache=True, nogil=True)
def clamp(limits: Array, pose: Array) -> None:
    """Bring pose (D,) into the limits (D, 2), in place."""
    for j in range(len(pose)):
        pose[j] = min(max(pose[j], limits[j, 0]), limits[j, 1])
