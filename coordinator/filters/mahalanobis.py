"""Refined particles that a frame cannot tell apart become one hypothesis (step 6 of preset `default`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.kinematics.chain import contiguous
from common.kinematics.manifold import ball_vector
from common.kinematics.rotations import handedness

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Triangles = NDArray[np.float32]  # (N, D (D + 1) / 2)

VALLEY = 2.0 / 3.0  # of a variance in each degree of freedom, in the mean, by which a valley ends


def merge_by_mahalanobis(
    model: BodyModel, poses: Array, log_likelihood: Array, roots: Triangles
) -> tuple[Indices, Indices]:
    """Group refined particles (N, D) whose squared Mahalanobis distance is below VALLEY times D.

    As `merging.merge`, but that how near is near depends on the representative: what a frame says nothing
    about, as the twist of a forearm, keeps no particles apart, and what it shows well does by millimetres.

    Args:
        model: The body.
        poses: Refined particles (N, D).
        log_likelihood: Of each (N,).
        roots: Cholesky factors of their covariances, lower triangles.
    """
    order = np.argsort(-log_likelihood, kind="stable")
    chosen, group = np.empty_like(order), np.empty_like(order)
    count = join_by_mahalanobis(order, contiguous(poses), roots, model.axes, model.balls, chosen, group)
    return chosen[:count], group


@numba.njit(cache=True, nogil=True)
def join_by_mahalanobis(
    order: Indices,
    poses: Array,
    roots: Triangles,
    axes: Array,
    balls: Indices,
    chosen: Indices,
    group: Indices,
) -> int:
    """Fill chosen and group (N,) as `merge_by_mahalanobis` gives them; the number of representatives."""
    count, step, handed = 0, np.empty(poses.shape[1]), np.empty(len(balls))
    for b in range(len(balls)):
        handed[b] = handedness(axes, balls[b])
    for n in order:
        group[n] = count
        for m in range(count):
            if is_in_valley(poses[chosen[m]], poses[n], roots[chosen[m]], balls, handed, step):
                group[n] = m
                break
        if group[n] == count:
            chosen[count] = n
            count += 1
    return count


@numba.njit(cache=True, nogil=True, error_model="numpy")
def is_in_valley(
    origin: Array, pose: Array, root: NDArray[np.float32], balls: Indices, handed: Array, step: Array
) -> bool:
    """Whether a pose (D,) lies in the valley of another one, whose covariance has this root (D (D + 1) / 2,).

    The first degrees of freedom separate most already; balls need matrices. `step` (D,) is for computing.
    """
    total, place, ball = 0.0, 0, 0
    rim = VALLEY * len(step)
    for i in range(len(step)):
        step[i] = pose[i] - origin[i]
    for i in range(len(step)):
        if ball < len(balls) and i == balls[ball]:
            step[i], step[i + 1], step[i + 2] = ball_vector(handed[ball], origin, pose, i)
            ball += 1
        for j in range(i):
            step[i] -= root[place + j] * step[j]
        step[i] /= root[place + i]
        total += step[i] * step[i]
        if not total < rim:
            return False
        place += i + 1
    return True
