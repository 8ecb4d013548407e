"""Calibrates a rig by a person who moves: each camera tracks the person alone, and the joints are aligned.

The clock offset is the one with the smallest residual of the rigid fit. Joints are weighted with their
variances and a robust kernel, as a limb that a camera does not see may be wrong by much.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from common.arrays import Array
from common.camera import inverse, moved
from common.errors import InputError
from common.settings import Settings
from coordinator.bodies.tracked import Bodies
from coordinator.sources.source import Source
from coordinator.tracking.estimate import UNKNOWN, Estimate
from coordinator.tracking.refiner import Refiner
from coordinator.tracking.tracker import Tracker

MISFIT_M = 0.09  # largest mean residual of joints of the same person
LARGEST = np.repeat([np.radians(1.0), 0.02, 0.008], (3, 3, 1))  # deviations; with larger ones it is a guess
STEP_S = 1.0 / 60.0  # between the offsets that are tried
OUTLIER_M = 0.1  # scale of the robust kernel
BLOCK_S = 0.5  # longer than pose errors are correlated
POSITION_M, SIGHT_M = 0.0015, 0.006  # deviations of a body's place: in any direction, along a line of sight
WHAT = ("rotation", "position", "clock")
ADVICE = ("walk through the view of {}", "walk closer to {} and turn about", "wave before {}")


def calibrate(
    sources: Mapping[str, Source],
    refiner: Refiner,
    settings: Settings,
    bodies: Bodies,
    report: Callable[[str], None] = lambda _: None,
) -> dict[str, CameraPose]:
    """The poses of cameras by name, in the frame and the time of the first one.

    Raises InputError if the recordings do not determine them.
    """
    names, motions = list(sources), []
    for name, source in sources.items():
        report(f"tracking {name} alone")
        followed = Tracker(refiner, settings, bodies).follow(source)
        motions.append(motion_of([tracked.estimate for (tracked,) in followed]))
    first, poses = names[0], {names[0]: CameraPose(np.eye(4), 0.0, 0.0, np.zeros(7))}
    for name, motion in zip(names[1:], motions[1:], strict=True):
        found = align(motions[0], motion)
        if found is None:
            raise InputError(
                f"{name} and {first} do not show the person at the same time; record at least a second of it"
            )
        if found.residual_m > MISFIT_M:
            raise InputError(
                f"{name} does not show the motion of {first}: joints are {100 * found.residual_m:.0f} cm "
                "apart at best; record one person who moves in front of both"
            )
        poses[name] = found
    return {name: judge(name, each) for name, each in poses.items()}


def judge(name: str, found: CameraPose) -> CameraPose:
    """A pose, with what would make its largest deviation smaller; InputError if it is not determined."""
    worst = int(np.argmax(found.deviations / LARGEST))
    advice = ADVICE[worst // 3].format(name)
    if not found.deviations[worst] <= LARGEST[worst]:
        raise InputError(f"the {WHAT[worst // 3]} of {name} is not determined; {advice}, and record again")
    return replace(found, advice=advice)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The joints of a person over time, as one camera sees them.

    time_s: (F,) ascending. joints: (F, J, 3) metres, camera frame. variance: (F, J) m^2; infinite if unknown.
    """

    time_s: Array
    joints: Array
    variance: Array

    def at(self, times: Array) -> tuple[Array, Array]:
        """Joints (T, J, 3) and variances (T, J) at other times, by linear interpolation."""
        after = np.clip(np.searchsorted(self.time_s, times, side="right"), 1, len(self.time_s) - 1)
        share = (times - self.time_s[after - 1]) / (self.time_s[after] - self.time_s[after - 1])
        inside = (share >= 0.0) & (share <= 1.0)
        between = (1.0 - share)[:, None, None] * self.joints[after - 1] + share[:, None, None] * self.joints[
            after
        ]
        variance = np.maximum(self.variance[after - 1], self.variance[after])
        return between, np.where(inside[:, None], variance, np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """The pose of a camera relative to the first, and its uncertainty.

    T_first_other: (4, 4). offset_s: of its clock. residual_m: mean residual. deviations: (7,) of the
    rotation about the first camera's axes and of the position at the person, radians and metres; and of the
    clock, seconds; infinite if they are not known. advice: what would make the largest of them smaller.
    """

    T_first_other: Array
    offset_s: float
    residual_m: float
    deviations: Array = field(default_factory=lambda: np.full(7, np.inf))
    advice: str = ""


def motion_of(estimates: list[Estimate]) -> Motion:
    """The motion of a tracked person."""
    joints = np.array([each.joint_positions for each in estimates])
    variance = np.full(joints.shape[:2], np.inf)
    for f, each in enumerate(estimates):
        if each.status not in UNKNOWN and each.certainty is not None:
            variance[f] = each.certainty.deviation**2
    return Motion(np.array([each.time_s for each in estimates]), np.nan_to_num(joints), variance)


def align(first: Motion, other: Motion) -> CameraPose | None:
    """Align the joints of another camera with those of the first; None if they have too little in common."""
    length = min(np.ptp(first.time_s), np.ptp(other.time_s))
    least = max(1.0, 0.5 * length)  # seconds
    earliest = first.time_s[0] + least - other.time_s[-1]
    latest = first.time_s[-1] - least - other.time_s[0]
    offsets: list[float] = np.arange(earliest, latest + STEP_S, STEP_S).tolist()
    fits = [fit_at(first, other, offset) for offset in offsets]
    known = [each for each in fits if each is not None]
    if not known:
        return None
    coarse = min(known, key=lambda each: each.residual_m).offset_s
    found = fit_near(first, other, coarse)
    return None if found is None else replace(found, deviations=deviations_of(first, other, found))


def deviations_of(first: Motion, other: Motion, found: CameraPose) -> Array:
    """Deviations (7,) of an alignment, from the jackknife by blocks of time and by joints.

    Pose errors correlate within a block, those of a joint's position at all times. A body that is
    too thick or too thin is displaced along the line of sight of each camera.
    """
    known = np.isfinite(first.variance)
    person = first.joints[known].mean(axis=0)
    blocks = np.unique((first.time_s / BLOCK_S).astype(np.int64), return_inverse=True)[1][:, None]
    variance = np.zeros(7)
    for groups in (blocks, np.arange(first.joints.shape[1])):
        changes = list[Array]()
        for each in np.unique(groups).tolist():
            variances = np.where(groups == each, np.inf, first.variance)
            without = fit_near(replace(first, variance=variances), other, found.offset_s)
            if without is not None:
                moves = without.T_first_other @ inverse(found.T_first_other)
                turn = Rotation.from_matrix(moves[:3, :3]).as_rotvec()
                clock = without.offset_s - found.offset_s
                changes.append(np.array([*turn, *(moved(person, moves) - person), clock]))
        variance += (len(changes) - 1.0) * np.var(changes, axis=0) if len(changes) > 1 else np.inf
    sight, other_sight = person, person - found.T_first_other[:3, 3]
    apart = sight / np.linalg.norm(sight) - other_sight / np.linalg.norm(other_sight)
    variance[3:6] += POSITION_M**2 + (SIGHT_M * apart) ** 2
    return np.sqrt(variance)


def fit_near(first: Motion, other: Motion, offset_s: float) -> CameraPose | None:
    """The rigid fit with the best clock offset near this one; None if nothing is known at the same time."""
    fits = [fit_at(first, other, offset_s + step) for step in (-STEP_S, 0.0, STEP_S)]
    before, at, after = (np.inf if fit is None else fit.residual_m**2 for fit in fits)
    if not np.isfinite([before, at, after]).all():
        return fits[1]
    shift = 0.5 * (before - after) / max(before - 2.0 * at + after, 1e-12)
    return fit_at(first, other, offset_s + STEP_S * float(np.clip(shift, -0.5, 0.5)))


def fit_at(first: Motion, other: Motion, offset_s: float) -> CameraPose | None:
    """The rigid fit with a clock offset; None if nothing is known at the same time."""
    joints, variance = other.at(first.time_s - offset_s)
    weights = (1.0 / (first.variance + variance)).ravel()
    if np.count_nonzero(weights) < joints.shape[1]:
        return None
    here, there, robust = first.joints.reshape(-1, 3), joints.reshape(-1, 3), np.ones_like(weights)
    for _ in range(4):
        transform = rigid_fit(there, here, weights * robust)
        squares = np.sum((moved(there, transform) - here) ** 2, axis=1)
        robust = (OUTLIER_M**2 / (OUTLIER_M**2 + squares)) ** 2
    cost = OUTLIER_M**2 * squares / (OUTLIER_M**2 + squares)
    return CameraPose(transform, offset_s, float(np.sqrt(np.average(cost, weights=weights))))


def rigid_fit(points: Array, targets: Array, weights: Array) -> Array:
    """The rigid transform (4, 4) that moves points (N, 3) to targets (N, 3) best (Kabsch, 1976)."""
    total = weights / weights.sum()
    middle, target = total @ points, total @ targets
    left, _, right = np.linalg.svd((targets - target).T @ ((points - middle) * total[:, None]))
    transform = np.eye(4)
    transform[:3, :3] = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    transform[:3, 3] = target - transform[:3, :3] @ middle
    return transform
