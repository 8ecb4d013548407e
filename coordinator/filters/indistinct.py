"""Refined particles that a frame cannot tell apart become one hypothesis (step 6 of preset `default`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.kinematics.arrays import contiguous
from common.kinematics.manifold import ball_vector
from common.kinematics.rotations import handedness

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Triangles = NDArray[np.float32]  # (N, D (D + 1) / 2)

VALLEY = 2.0 / 3.0  # of a variance in each degree of freedom, in the mean, by which a valley ends


def merge_indistinct(
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
    count = join_indistinct(order, contiguous(poses), roots, model.axes, model.balls, chosen, group)
    return chosen[:count], group


@numba.njit(cache=True, nogil=True)
def join_indistinct(
    order: Indices,
    poses: Array,
    roots: Triangles,
    axes: Array,
    balls: Indices,
    chosen: Indices,
    group: Indices,
) -> int:
    """Fill chosen and group (N,) as `merge_indistinct` gives them; the number of representatives."""
    count, step, rim = 0, np.empty(poses.shape[1]), VALLEY * poses.shape[1]
    for n in order:
        group[n] = count
        for m in range(count):
            fill_step(poses[chosen[m]], poses[n], axes, balls, step)
            if squared_distance(roots[chosen[m]], step) < rim:
                group[n] = m
                break
        if group[n] == count:
            chosen[count] = n
            count += 1
    return count


@numba.njit(cache=True, nogil=True)
def fill_step(origin: Array, pose: Array, axes: Array, balls: Indices, step: Array) -> None:
    """Fill step (D,), which leads from a pose (D,) to another: `difference` of the two."""
    step[:] = pose - origin
    for start in balls:
        handed = handedness(axes[start : start + 3])
        ball_vector(handed, origin[start : start + 3], pose[start : start + 3], step[start:])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def squared_distance(root: NDArray[np.float32], step: Array) -> float:
    """Squared Mahalanobis length of a step (D,), by a lower triangle (D (D + 1) / 2,); the step is lost."""
    total, place = 0.0, 0
    for i in range(len(step)):
        for j in range(i):
            step[i] -= root[place + j] * step[j]
        step[i] /= root[place + i]
        total += step[i] * step[i]
        place += i + 1
    return total
