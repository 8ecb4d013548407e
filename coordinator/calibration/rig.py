"""Calibrates a rig by a person who moves: each camera tracks the person alone, and the joints are aligned.

A template that is too thin is placed too near to each camera, its trunk by more than its head and feet. So
the fit also estimates the girth.

The clock offset is the one with the smallest residual of the fit. Joints are weighted by their inverse
variances and a robust kernel, because a limb that a camera does not see may be far off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.camera import inverse, moved, rigid
from gepf.common.errors import InputError
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions
from gepf.common.refinement import Particles
from gepf.coordinator.bodies.family import Bodies
from gepf.coordinator.bodies.human.shape_space import Size
from gepf.coordinator.filters.priors import pose_prior
from gepf.coordinator.scene.noise import assume_noise
from gepf.coordinator.settings import Settings
from gepf.coordinator.sources.source import Source
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN
from gepf.coordinator.tracking.refiner import Refiner, with_iterations
from gepf.coordinator.tracking.reporting import TrackedPerson
from gepf.coordinator.tracking.tracker import Tracker


class CalibrationSettings(msgspec.Struct, frozen=True):
    """How joints of a person, as several cameras see them, are aligned."""

    max_misfit_m: float = 0.09  #: mean residual of joints of the same person
    step_s: float = 1.0 / 60.0  #: between the offsets that are tried
    outlier_m: float = 0.1  #: scale of the robust kernel
    block_s: float = 0.5  #: longer than pose errors are correlated
    position_m: float = 0.0015  #: deviation of a body's place in any direction
    sight_m: float = 0.004  #: the same along a line of sight


SETTINGS = CalibrationSettings()
LARGEST = np.repeat([np.radians(1.0), 0.02, 0.008], (3, 3, 1))  # deviations of a pose that is determined
GIRTHS = np.array([0.85, 1.15])  # relative to the estimated one, of a thinner and a thicker body
WHAT = ("rotation", "position", "clock")
ADVICE = ("walk through the view of {}", "walk closer to {} and turn around", "wave in front of {}")


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
        motions.append(track_alone(source, refiner, settings, bodies))
    first, poses = names[0], {names[0]: CameraPose(np.eye(4), 0.0, 0.0, np.zeros(7))}
    for name, motion in zip(names[1:], motions[1:], strict=True):
        found = align(motions[0], motion)
        if found is None:
            raise InputError(
                f"{name} and {first} do not show the person at the same time; record both for at least 1 s"
            )
        if found.residual_m > SETTINGS.max_misfit_m:
            raise InputError(
                f"{name} does not show the motion of {first}: joints are {100 * found.residual_m:.0f} cm "
                "apart at best; record one person who moves in front of both"
            )
        poses[name] = found
    return {name: advised(name, each) for name, each in poses.items()}


def advised(name: str, found: CameraPose) -> CameraPose:
    """A pose with advice on reducing its largest deviation; InputError if the pose is not determined."""
    worst = int(np.argmax(found.deviations / LARGEST))
    advice = ADVICE[worst // 3].format(name)
    if not found.deviations[worst] <= LARGEST[worst]:
        raise InputError(f"the {WHAT[worst // 3]} of {name} is not determined; {advice}, and record again")
    return replace(found, advice=advice)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """The joints of a person over time, as one camera sees them.

    time_s: (F,) ascending. joints: (F, J, 3) metres, camera frame, of a body of girth 1. variance: (F, J)
    m^2; infinite if unknown. jacobian: (F, J, 3) with respect to the girth.
    """

    time_s: Array
    joints: Array
    variance: Array
    jacobian: Array

    def at(self, times: Array) -> Motion:
        """The motion at other times, by linear interpolation."""
        after = np.clip(np.searchsorted(self.time_s, times, side="right"), 1, len(self.time_s) - 1)
        share = (times - self.time_s[after - 1]) / (self.time_s[after] - self.time_s[after - 1])
        inside = (share >= 0.0) & (share <= 1.0)
        before, share = after - 1, share[:, None, None]
        variance = np.maximum(self.variance[before], self.variance[after])
        joints, jacobian = (
            (1.0 - share) * values[before] + share * values[after] for values in (self.joints, self.jacobian)
        )
        return Motion(times, joints, np.where(inside[:, None], variance, np.inf), jacobian)


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


def track_alone(source: Source, refiner: Refiner, settings: Settings, bodies: Bodies) -> Motion:
    """The motion of a person whom one camera shows; its Jacobian is measured once in `block_s`."""
    rows = list[tuple[float, Array, Array, Array]]()
    next_s, jacobian = -np.inf, np.zeros(3)
    for frame in Tracker(refiner, settings, bodies).follow(source):
        (tracked,) = frame.people
        estimate, deviation = tracked.estimate, np.full(len(tracked.estimate.joint_positions), np.inf)
        if estimate.status not in POSE_UNKNOWN:
            deviation = estimate.certainty.deviation
            if tracked.subject is not None and estimate.time_s >= next_s:
                next_s = estimate.time_s + SETTINGS.block_s
                jacobian = measure_jacobian(tracked, tracked.subject, refiner, settings, bodies)
        girth = Size(*tracked.state.size).girth if tracked.state.size else np.nan
        to_girth_1 = (1.0 - girth) * jacobian
        joints = np.nan_to_num(estimate.joint_positions + to_girth_1)
        rows.append((estimate.time_s, joints, deviation**2, np.broadcast_to(jacobian, joints.shape)))
    return Motion(*map(np.array, zip(*rows, strict=True)))


def measure_jacobian(
    tracked: TrackedPerson, subject: SubjectFrame, refiner: Refiner, settings: Settings, bodies: Bodies
) -> Array:
    """Derivatives (J, 3) of the joints with respect to the girth, by fits of a thinner and a thicker body."""
    start, rules = tracked.state.start, assume_noise(settings.refine, tracked.state.start.noise)
    pose, settled = tracked.estimate.pose[None], with_iterations(rules, settings.search.iterations)
    size = Size(*tracked.state.size)
    girths = size.girth * GIRTHS
    models = [bodies.tracked(size._replace(girth=girth), start.values)[0] for girth in girths.tolist()]
    sent = [
        refiner.submit(subject, m, Particles(pose, settled, spare=True, prior=pose_prior(m, settled)))
        for m in models
    ]
    thin, thick = (joint_positions(m, p.result().poses)[0] for m, p in zip(models, sent, strict=True))
    return np.asarray((thick - thin) / np.ptp(girths))


def align(first: Motion, other: Motion) -> CameraPose | None:
    """Align the joints of another camera with those of the first; None if they have too little in common."""
    length = min(np.ptp(first.time_s), np.ptp(other.time_s))
    least = max(1.0, 0.5 * length)  # seconds
    earliest = first.time_s[0] + least - other.time_s[-1]
    latest = first.time_s[-1] - least - other.time_s[0]
    offsets: list[float] = np.arange(earliest, latest + SETTINGS.step_s, SETTINGS.step_s).tolist()
    fits = [fit_at(first, other, offset) for offset in offsets]
    known = [each for each in fits if each is not None]
    if not known:
        return None
    coarse = min(known, key=lambda each: each.residual_m).offset_s
    found = fit_near(first, other, coarse)
    return None if found is None else replace(found, deviations=deviations_of(first, other, found))


def deviations_of(first: Motion, other: Motion, found: CameraPose) -> Array:
    """Deviations (7,) of an alignment, from the jackknife by blocks of time and by joints.

    Pose errors correlate within a block, those of a joint's position at all times. What is left of a wrong
    size displaces the body along the line of sight of each camera.
    """
    known = np.isfinite(first.variance)
    person = first.joints[known].mean(axis=0)
    blocks = np.unique((first.time_s / SETTINGS.block_s).astype(np.int64), return_inverse=True)[1][:, None]
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
    variance[3:6] += SETTINGS.position_m**2 + (SETTINGS.sight_m * apart) ** 2
    return np.sqrt(variance)


def fit_near(first: Motion, other: Motion, offset_s: float) -> CameraPose | None:
    """The rigid fit with the best clock offset near this one; None if nothing is known at the same time."""
    fits = [fit_at(first, other, offset_s + step) for step in (-SETTINGS.step_s, 0.0, SETTINGS.step_s)]
    before, at, after = (np.inf if fit is None else fit.residual_m**2 for fit in fits)
    if not np.isfinite([before, at, after]).all():
        return fits[1]
    shift = 0.5 * (before - after) / max(before - 2.0 * at + after, 1e-12)
    return fit_at(first, other, offset_s + SETTINGS.step_s * float(np.clip(shift, -0.5, 0.5)))


def fit_at(first: Motion, other: Motion, offset_s: float) -> CameraPose | None:
    """The fit of pose and girth with a clock offset; None if nothing is known at the same time."""
    other = other.at(first.time_s - offset_s)
    weights = (1.0 / (first.variance + other.variance)).ravel()
    if np.count_nonzero(weights) < first.joints.shape[1]:
        return None
    here, there, jacobian_here, jacobian_there = (
        each.reshape(-1, 3) for each in (first.joints, other.joints, first.jacobian, other.jacobian)
    )
    robust, girth = np.ones_like(weights), 0.0
    # of the girth, in units of the weights: errors of joints are correlated, so a block counts as one frame
    prior = SETTINGS.block_s * (len(first.time_s) - 1) / np.ptp(first.time_s) / (0.5 * np.ptp(GIRTHS)) ** 2
    for _ in range(5):
        robust_weights = weights * robust
        transform = rigid_fit(there, here, robust_weights)
        apart = moved(there, transform) - here
        squares = np.sum(apart**2, axis=1)
        scale = SETTINGS.outlier_m**2
        robust = (scale / (scale + squares)) ** 2
        jacobian = jacobian_there @ transform[:3, :3].T - jacobian_here
        jacobian -= np.average(jacobian, axis=0, weights=robust_weights)  # their mean is a translation
        gradient = np.sum(robust_weights @ (jacobian * apart)) + prior * girth
        step = -gradient / (np.sum(robust_weights @ jacobian**2) + prior)
        here, there, girth = here + step * jacobian_here, there + step * jacobian_there, girth + step
    scale = SETTINGS.outlier_m**2
    cost = scale * squares / (scale + squares)
    return CameraPose(transform, offset_s, float(np.sqrt(np.average(cost, weights=weights))))


def rigid_fit(points: Array, targets: Array, weights: Array) -> Array:
    """The rigid transform (4, 4) that moves points (N, 3) to targets (N, 3) best (Kabsch, 1976)."""
    total = weights / weights.sum()
    middle, target = total @ points, total @ targets
    left, _, right = np.linalg.svd((targets - target).T @ ((points - middle) * total[:, None]))
    rotation = left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return rigid(rotation, target - rotation @ middle)
