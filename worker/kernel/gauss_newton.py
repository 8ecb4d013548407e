"""The pose that minimises the distances of given correspondences (step 4d, Eq. 3-5), without its points.

The model is linear in each link's transform. With X = [p; 1] a model point and p~ the observed point that
belongs to it, the sums M_s = sum w X X^T and C_s = sum w X p~^T of each link s hold all that Eq. 3-5 need:
with A_j = [w_j]x [I | -q_j] for a rotation, column j of the Jacobian is A_j X, so

    (J^T J)_jk = sum_s tr(A_j M_s A_k^T)        (J^T r)_j = sum_s tr(A_j (M_s E - C_s)),  E = [I | 0]^T

over the links s that both (that) degrees of freedom move. A link's relative motion G takes M_s to
G M_s G^T and C_s to G C_s, so a step costs the same for a thousand points as for a million.

A vertex that is blended over several links adds to each of them in proportion to its weights. That leaves
J^T r exact at the pose in which correspondences were searched, and makes J^T J an upper bound, so steps stay
safe.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from common.kinematics import (
    apply_step,
    ball_turn,
    carry_axes,
    chain,
    euler_matrix,
    handedness,
    rotation_vector,
)
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.tiles import add_products

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LIMIT_SHARE = 0.002  # weight of a squared radian outside a ball's limits, for each point
SINGULAR = 1e-13  # of the largest entry on the diagonal
CONVERGED = 1e-4  # radians and metres: a step below it ends the loop


class Descent(NamedTuple):
    """How to go down."""

    metric: Array  # (3,) weights of the camera's axes
    damping: float
    stiffness: float  # weight of a squared joint angle
    iterations: int
    keep_limits: bool


class Equations(NamedTuple):
    """Room for the sums and for Eq. 4; whatever it held before is written over."""

    sums: Array  # (L, 4, 8) both of the following in a row, as they are summed up
    moments: Array  # (L, 4, 4)
    crosses: Array  # (L, 4, 3)
    reference: Array  # (D, 3, 4) T_camera_rest where the sums were taken
    moved: Array  # (D, 3, 4) T_camera_rest now
    w: Array  # (D, 3)
    q: Array  # (D, 3)
    subtree_m: Array  # (D, 4, 4)
    subtree_c: Array  # (D, 4, 3)
    columns: Array  # (D, 3, 4)
    gram: Array  # (D, D)
    gradient: Array  # (D,)
    step: Array  # (D,)


def lay_out_equations(dofs: int, links: int) -> Equations:
    """Room for a body of so many degrees of freedom and links."""
    return Equations(
        np.empty((links, 4, 8)),
        np.empty((links, 4, 4)),
        np.empty((links, 4, 3)),
        np.empty((dofs, 3, 4)),
        np.empty((dofs, 3, 4)),
        np.empty((dofs, 3)),
        np.empty((dofs, 3)),
        np.empty((dofs, 4, 4)),
        np.empty((dofs, 4, 3)),
        np.empty((dofs, 3, 4)),
        np.empty((dofs, dofs)),
        np.empty(dofs),
        np.empty(dofs),
    )


@numba.njit(cache=True, nogil=True)
def add_correspondences(
    surface: Surface, visible: NDArray[np.uint32], posed: Array, pulls: Array, equations: Equations
) -> None:
    """Moments and crosses of the visible ones of posed (V, 3), each drawn to observed points.

    pulls (V, 4) are those points' weighted sum and weight, in the order of `visible`.
    """
    links, weights, sums = surface.skin_links, surface.skin_weights, equations.sums
    sums[:] = 0.0
    for m in range(len(visible)):
        v = visible[m]
        if pulls[m, 3] > 0.0:
            for k in range(links.shape[1]):
                share = weights[v, k]
                if not share > 0.0:
                    break
                x, y, z = posed[v, 0], posed[v, 1], posed[v, 2]
                add_products(sums, links[v, k], share, x, y, z, pulls, m)  # type: ignore[call-arg]
    equations.moments[:] = sums[:, :, :4]
    equations.crosses[:] = sums[:, :, 4:7]


@numba.njit(cache=True, nogil=True)
def minimise(skeleton: Skeleton, pose: Array, descent: Descent, equations: Equations) -> None:
    """Move pose (D,) in place to the minimum of Eq. 3 by damped Gauss-Newton steps (Eq. 4).

    The equations' moments and crosses are in the camera frame at the pose given.
    """
    gram, gradient, step = equations.gram, equations.gradient, equations.step
    chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, equations.reference)
    for _ in range(descent.iterations):
        chain(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, equations.moved)
        subtree_moments(skeleton, equations)
        normal_equations(skeleton, descent.metric, equations)
        for j in range(len(pose)):
            gram[j, j] += descent.damping
        if descent.stiffness > 0.0:
            draw_to_rest(skeleton, pose, descent.stiffness, gram, gradient)
        if descent.keep_limits:
            mass = LIMIT_SHARE * equations.moments[:, 3, 3].sum()
            draw_into_limits(skeleton, pose, mass, gram, gradient)
            hold_at_limits(skeleton, pose, gram, gradient)
        step[:] = -gradient
        solve_along_chains(skeleton.parents, gram, step)  # Eq. 4
        apply_step(skeleton.axes, skeleton.balls, step, pose)
        if descent.keep_limits:
            clamp(skeleton, pose)
        if np.max(np.abs(step)) < CONVERGED:
            break


@numba.njit(cache=True, nogil=True)
def extend(skeleton: Skeleton, before: Array, share: float, pose: Array) -> None:
    """Move pose (D,) on in place by a share of the motion that led there from `before`."""
    step = pose - before
    for start in skeleton.balls:
        handed = handedness(skeleton.axes[start : start + 3])
        ball_turn(handed, before[start : start + 3], pose[start : start + 3], step[start:])
    apply_step(skeleton.axes, skeleton.balls, share * step, pose)


@numba.njit(cache=True, nogil=True)
def solve_along_chains(parents: Indices, gram: Array, step: Array) -> None:
    """Solve gram (D, D) x = step (D,) in place; gram is lost.

    Degrees of freedom that lie on different branches share no moved link, so their entries are zero and stay
    zero in gram = L^T L with L lower triangular, which is found from the tips to the root along the
    ancestors of each (Featherstone, Rigid Body Dynamics Algorithms, section 6.5). Where gram is singular
    what nothing determines stays where it is.
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
def subtree_moments(skeleton: Skeleton, equations: Equations) -> None:
    """Moments (D, 4, 4) and (D, 4, 3), at the moved pose, of all that each degree of freedom moves."""
    moments, crosses = equations.moments, equations.crosses
    subtree_m, subtree_c = equations.subtree_m, equations.subtree_c
    subtree_m[:] = 0.0
    subtree_c[:] = 0.0
    g, half = np.zeros((4, 4)), np.empty((4, 4))
    for s in range(len(skeleton.link_dofs)):
        j = skeleton.link_dofs[s]
        if j < 0 or moments[s, 3, 3] == 0.0:
            continue
        relative_motion(equations.reference[j], equations.moved[j], g)
        multiply(g, moments[s], half)
        for a in range(4):
            for b in range(4):
                for c in range(4):
                    subtree_m[j, a, b] += half[a, c] * g[b, c]
                    if b < 3:
                        subtree_c[j, a, b] += g[a, c] * crosses[s, c, b]
    for j in range(len(subtree_m) - 1, 0, -1):
        if skeleton.parents[j] >= 0:
            hand_down(subtree_m, subtree_c, j, skeleton.parents[j])


@numba.njit(cache=True, nogil=True)
def hand_down(subtree_m: Array, subtree_c: Array, j: int, parent: int) -> None:
    """What a degree of freedom moves its parent moves, too."""
    for a in range(4):
        for b in range(4):
            subtree_m[parent, a, b] += subtree_m[j, a, b]
        for b in range(3):
            subtree_c[parent, a, b] += subtree_c[j, a, b]


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


@numba.njit(cache=True, nogil=True)
def multiply(one: Array, other: Array, out: Array) -> None:
    """out = one @ other, (4, 4)."""
    for a in range(4):
        for b in range(4):
            out[a, b] = (
                one[a, 0] * other[0, b]
                + one[a, 1] * other[1, b]
                + one[a, 2] * other[2, b]
                + one[a, 3] * other[3, b]
            )


@numba.njit(cache=True, nogil=True)
def normal_equations(skeleton: Skeleton, metric: Array, equations: Equations) -> None:
    """Fill gram (D, D) with J^T J and gradient (D,) with J^T r at the moved pose."""
    w, q, columns, m, c = (
        equations.w,
        equations.q,
        equations.columns,
        equations.subtree_m,
        equations.subtree_c,
    )
    gram, gradient = equations.gram, equations.gradient
    carry_axes(skeleton.parents, skeleton.axes, skeleton.points, skeleton.balls, equations.moved, w, q)
    gram[:, :] = 0.0
    product = np.empty((3, 4))
    for k in range(len(gram)):
        jacobian_matrix(skeleton.kinds[k], w[k], q[k], columns[k])
        gradient[k] = 0.0
        for r in range(3):
            for b in range(4):
                product[r, b] = 0.0
                for a in range(4):
                    product[r, b] += columns[k, r, a] * m[k, a, b]
                gradient[k] += metric[r] * columns[k, r, b] * (m[k, b, r] - c[k, b, r])
        j = k
        while j >= 0:  # only ancestors share moved links
            total = 0.0
            for r in range(3):
                for b in range(4):
                    total += metric[r] * product[r, b] * columns[j, r, b]
            gram[j, k] = gram[k, j] = total
            j = skeleton.parents[j]


@numba.njit(cache=True, nogil=True)
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
def draw_to_rest(skeleton: Skeleton, pose: Array, stiffness: float, gram: Array, gradient: Array) -> None:
    """Add the squared angles of all joints but the root to the equations; of a ball, its turn's angle."""
    deviation = pose.copy()
    for start in skeleton.balls:
        axes = skeleton.axes[start : start + 3]
        handed = handedness(axes)
        deviation[start : start + 3] = handed * rotation_vector(
            euler_matrix(handed * pose[start : start + 3])
        )
    for j in range(len(pose)):
        if not skeleton.root[j]:
            gram[j, j] += stiffness
            gradient[j] += stiffness * deviation[j]


@numba.njit(cache=True, nogil=True)
def single_axes(skeleton: Skeleton) -> NDArray[np.bool_]:
    """Which degrees of freedom (D,) are not part of a ball."""
    single = np.ones(len(skeleton.parents), dtype=np.bool_)
    for start in skeleton.balls:
        single[start : start + 3] = False
    return single


@numba.njit(cache=True, nogil=True)
def hold_at_limits(skeleton: Skeleton, pose: Array, gram: Array, gradient: Array) -> None:
    """Take out of the equations the single axes that stand at a limit and are pushed further out."""
    single = single_axes(skeleton)
    for j in range(len(pose)):
        low = pose[j] <= skeleton.limits[j, 0] and gradient[j] > 0.0
        high = pose[j] >= skeleton.limits[j, 1] and gradient[j] < 0.0
        if single[j] and (low or high):
            gram[j, :] = 0.0
            gram[:, j] = 0.0
            gram[j, j] = 1.0
            gradient[j] = 0.0


@numba.njit(cache=True, nogil=True)
def clamp(skeleton: Skeleton, pose: Array) -> None:
    """Bring the single axes of pose (D,) into their limits, in place."""
    single = single_axes(skeleton)
    for j in range(len(pose)):
        if single[j]:
            pose[j] = min(max(pose[j], skeleton.limits[j, 0]), skeleton.limits[j, 1])


@numba.njit(cache=True, nogil=True)
def draw_into_limits(skeleton: Skeleton, pose: Array, stiffness: float, gram: Array, gradient: Array) -> None:
    """Add the squared excess of each ball's angles over their limits to the equations.

    With R = R_1 R_2 R_3 a small turn d of the ball changes its angles by E^-1 d, E = [a_1, R_1 a_2,
    R_1 R_2 a_3] along the ball's axes. Where E is nearly singular the angles mean nothing and are let be.
    """
    for start in skeleton.balls:
        excess, outside = np.zeros(3), False
        for a in range(3):
            angle, low, high = pose[start + a], skeleton.limits[start + a, 0], skeleton.limits[start + a, 1]
            excess[a] = angle - min(max(angle, low), high)
            outside = outside or excess[a] != 0.0
        if outside and abs(np.cos(pose[start + 1])) > 0.3:
            rates = np.linalg.inv(
                euler_rates(pose[start : start + 3], handedness(skeleton.axes[start : start + 3]))
            )
            for a in range(3):
                if excess[a] != 0.0:
                    for b in range(3):
                        gradient[start + b] += stiffness * rates[a, b] * excess[a]
                        for c in range(3):
                            gram[start + b, start + c] += stiffness * rates[a, b] * rates[a, c]


@numba.njit(cache=True, nogil=True)
def euler_rates(angles: Array, handed: float) -> Array:
    """E (3, 3): turn of Rx(a) Ry(b) Rz(c), along the ball's axes, per change of its angles."""
    first = euler_matrix(np.array([handed * angles[0], 0.0, 0.0]))
    second = euler_matrix(np.array([handed * angles[0], handed * angles[1], 0.0]))
    rates = np.zeros((3, 3))
    rates[0, 0] = 1.0
    rates[:, 1] = first[:, 1]
    rates[:, 2] = second[:, 2]
    return rates
