"""From hundreds of candidates to the few that explain a frame: refine, keep the best that differ, again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.frame import SubjectFrame
from common.kinematics import joint_positions, natural_angles
from common.refinement import Refined
from common.settings import RefineSettings
from coordinator.tracking.refiner import Refiner

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """Candidates (N) after a stage, the likeliest first, on bodies of several sizes.

    joints: Positions (N, J, 3) in the camera frame, metres.
    """

    poses: Array  # (N, D)
    sizes: NDArray[np.int64]  # (N,) places in a list of bodies
    log_likelihood: Array  # (N,)
    residual: Array  # (N,) metres
    joints: Array  # (N, J, 3)

    def take(self, some: NDArray[np.int64]) -> Standing:
        """Only these, in this order."""
        return Standing(
            self.poses[some],
            self.sizes[some],
            self.log_likelihood[some],
            self.residual[some],
            self.joints[some],
        )

    def differing(self, count: int, apart: float) -> NDArray[np.int64]:
        """Where the likeliest are, ascending, that differ from all likelier ones.

        By more than `apart` metres in the mean joint.
        """
        return keep_differing(self.joints, count, apart)


@numba.njit(cache=True, nogil=True)
def keep_differing(joints: Array, count: int, apart: float) -> NDArray[np.int64]:
    """Which of (N, J, 3), so many at the most, differ from all before by more than `apart` in the mean."""
    kept = np.empty(min(count, len(joints)), dtype=np.int64)
    found = 0
    for n in range(len(joints)):
        differs = found < len(kept)
        for k in range(found):
            differs = differs and mean_distance(joints[kept[k]], joints[n]) > apart
        if differs:
            kept[found] = n
            found += 1
    return kept[:found]


@numba.njit(cache=True, nogil=True)
def mean_distance(joints: Array, others: Array) -> float:
    """Of joints (J, 3) from others (J, 3)."""
    total = 0.0
    for j in range(len(joints)):
        x, y, z = joints[j, 0] - others[j, 0], joints[j, 1] - others[j, 1], joints[j, 2] - others[j, 2]
        total += np.sqrt(x * x + y * y + z * z)
    return total / len(joints)


def thin(subject: SubjectFrame, points: int) -> SubjectFrame:
    """The same frame with only so many of its points, evenly chosen."""
    count = len(subject.picked)
    chosen = np.arange(min(points, count)) * count // max(1, min(points, count))
    return replace(subject, picked=subject.picked[chosen])


def descend(
    refiner: Refiner,
    bodies: Sequence[BodyModel],
    poses: Array,
    sizes: NDArray[np.int64],
    settings: RefineSettings,
) -> Standing:
    """Poses (N, D) of bodies of sizes (N,) after their descent on the frame that was published last."""
    after, places = np.empty_like(poses), np.empty((len(poses), len(bodies[0].joint_names), 3))
    log_likelihood, residual = np.empty(len(poses)), np.empty(len(poses))
    for size in np.unique(sizes):
        of_size = np.flatnonzero(sizes == size)
        refined = refine(refiner, bodies[size], poses[of_size], settings)
        after[of_size] = refined.poses
        log_likelihood[of_size], residual[of_size] = refined.log_likelihood, refined.residual
        places[of_size] = joint_positions(bodies[size], after[of_size])
    order = np.argsort(-log_likelihood, kind="stable")
    order = order[np.isfinite(log_likelihood[order])]
    return Standing(after, sizes, log_likelihood, residual, places).take(order)


def refine(refiner: Refiner, model: BodyModel, poses: Array, settings: RefineSettings) -> Refined:
    """Poses (N, D) of one body after their descent on the frame that was published last."""
    refined = refiner.submit(model, poses, settings).result()
    return replace(refined, poses=natural_angles(model, refined.poses))


def rounds(settings: RefineSettings, count: int) -> RefineSettings:
    """So many iterations of ICP, each with a fresh look at what is visible."""
    return msgspec.structs.replace(settings, icp_iterations=count)
