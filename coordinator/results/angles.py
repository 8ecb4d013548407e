"""The angles of a track and their deviations; which of its joints are prismatic.

The reported angles of a hidden limb, and the rotation of an arm with a straight elbow, are arbitrary. The
deviation of each angle is known for each frame, and so is the speed of human joints. Angles with a misfit are
smoothed accordingly: the most likely x (F,) minimise

    sum_f (x_f - angle_f)^2 / variance_f + sum_f (x_f - x_{f-1})^2 / (speed interval_f)^2

Here `variance` is the variance of an angle beyond its misfit, so a visible angle does not change.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import TRANSLATION
from gepf.coordinator.bodies.angles import Angles
from gepf.coordinator.results.track import MODEL_FILE, NewArray, Track, filled_from, read_tracked_body
from gepf.coordinator.sources.camera import DEFAULT_FPS


class AngleSettings(msgspec.Struct, frozen=True):
    """How deviations of angles follow from hypotheses, and how angles are smoothed; radians, seconds."""

    spread_factor: float = 2.0
    """From the spread of hypotheses to the error, which is larger because there are few particles: for the
    same people, 69 % of the joints are within the resulting deviation, 96 % within twice of it."""
    max_deviation: float = np.radians(60.0)
    """Deviation of an angle that is not visible: about that of a random angle within a joint's range."""
    speed: float = np.radians(1400.0)
    """Standard deviation of the speed: a fast arm. Elbows of throwers reach 2 300 degrees per second."""
    min_variance: float = np.radians(1e-4) ** 2  #: in smoothing; an angle with less is left as it is
    max_variance: float = np.radians(1e4) ** 2  #: in smoothing; the variance of an unknown angle
    part_frames: int = 1024
    """Frames that are measured at once, so that memory does not grow with the hypotheses of a long run."""


ANGLES = AngleSettings()


def with_angles(track: Track, angles: Angles, new: NewArray = np.empty) -> Track:
    """The track with the angles (F, A) of its body and their deviations; a person's angles are smoothed.

    `new` allocates the arrays that are as long as the track.
    """
    unknown, placed, shape = track.unknown, track.placed, (len(track.frame), len(angles.names))
    if not placed.any():
        nothing = np.full(shape, np.nan)
        return replace(track, angle_names=angles.names, angle=nothing, angle_deviation=nothing.copy())
    first = int(np.argmax(placed))
    start = track.part(slice(first, first + 1))
    parts = [slice(n, n + ANGLES.part_frames) for n in range(0, shape[0], ANGLES.part_frames)]
    smoothed, last = angles.misfit > 0.0 and shape[0] > 1, None
    reported = new(shape[::-1], np.float64).T if smoothed else new(shape, np.float64)
    beyond = new(shape[::-1], np.float64).T if smoothed else np.empty((0, shape[1]))
    expected = new(shape, np.float64)
    for part in parts:
        known = filled_from(track.part(part), start)
        measured, others = measure(known, angles)
        followed, last = angles.follow_on(measured, unknown[part], last)
        reported[part] = followed
        if smoothed:
            off = deviations(known, angles, others, followed, np.inf)
            off[unknown[part]] = np.inf
            beyond[part] = np.maximum(off**2 - angles.misfit**2, 0.0)
        else:
            expected[part] = deviations(known, angles, others, followed, ANGLES.max_deviation)
    if smoothed:
        since = np.diff(track.time_s)
        interval = np.where(since > 0.0, since, 1.0 / DEFAULT_FPS)
        for column, variance in zip(reported.T, beyond.T, strict=True):
            column[:] = smooth(column, variance, interval)
        for part in parts:
            known = filled_from(track.part(part), start)
            others = measure(known, angles)[1]
            expected[part] = deviations(known, angles, others, reported[part], ANGLES.max_deviation)
    reported[~placed], expected[unknown] = np.nan, np.nan
    return replace(track, angle_names=angles.names, angle=reported, angle_deviation=expected)


def smooth(angle: Array, variance: Array, interval: Array) -> Array:
    """Smoothed angles (F,), radians; unknown angles follow from the neighbouring frames.

    `variance` (F,) is that of each angle; `interval` (F - 1,) the seconds between frames.
    """
    from scipy.linalg import solveh_banded  # slow to load

    weight = 1.0 / np.clip(variance, ANGLES.min_variance, ANGLES.max_variance)
    stiffness = 1.0 / (ANGLES.speed * interval) ** 2
    bands = np.zeros((2, len(angle)))
    bands[1] = weight
    bands[1, :-1] += stiffness
    bands[1, 1:] += stiffness
    bands[0, 1:] = -stiffness
    smoothed = solveh_banded(bands, weight * angle)
    return np.where(variance <= ANGLES.min_variance, angle, smoothed)


def measure(track: Track, angles: Angles) -> tuple[Array, Array]:
    """The angles (F, A) of the poses and those (F, M, A) of the hypotheses, radians.

    Where a hypothesis is missing, they are those of the pose.
    """
    known = np.isfinite(track.hypothesis_weight)
    others = np.where(known[..., None], track.hypothesis_pose, track.pose[:, None])
    poses = np.concatenate([track.pose[:, None], others], axis=1)
    found = angles.measure(poses.reshape(-1, poses.shape[2])).reshape(*poses.shape[:2], len(angles.names))
    return found[:, 0], found[:, 1:]


def deviations(track: Track, angles: Angles, others: Array, about: Array, most: float) -> Array:
    """Standard deviations (F, A) of the errors of angles `about` (F, A), given those of the hypotheses.

    For a robot, which has no misfit because its measures are known, they follow from the hypotheses alone.
    The straighter a limb is, the less certain is its rotation. Unknown angles have the deviation `most`.
    """
    away = near_to(about, others, angles) - about[:, None]
    spread = ANGLES.spread_factor * root_mean_square(away, track.hypothesis_weight)
    if not angles.misfit:
        return spread
    off = np.maximum(angles.misfit, deviations_from_joints(track, angles))
    for twist, bend in angles.levers.items():
        shown = np.sin(np.clip(about[:, bend], 0.0, 0.5 * np.pi))  # 0 straight, 1 at a right angle
        off[:, twist] /= np.sqrt(np.maximum(shown**2, 1e-9))
    return np.asarray(np.hypot(np.minimum(off, most), spread))


def root_mean_square(away: Array, weight: Array) -> Array:
    """Weighted root mean square (F, C) of the distances `away` (F, M, C) of hypotheses, by weight (F, M).

    It is zero for a frame with one hypothesis: it measures the ambiguity, not the accuracy of the reported
    pose. Missing hypotheses are NaN.
    """
    weight = np.nan_to_num(weight)
    squares = np.einsum("fm,fmc->fc", weight, np.nan_to_num(away) ** 2)
    mean: Array = squares / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    return np.sqrt(mean)


def near_to(about: Array, others: Array, angles: Angles) -> Array:
    """Angles (F, M, A) of hypotheses, shifted by full turns towards `about` (F, A)."""
    flat = others.reshape(-1, others.shape[2])
    return angles.near(flat, np.repeat(about, others.shape[1], axis=0)).reshape(others.shape)


def deviations_from_joints(track: Track, angles: Angles) -> Array:
    """Deviations (F, A) of angles, radians, from those of the joints that they move; 0 if unknown."""
    at = {name: j for j, name in enumerate(track.joint_names)}
    joints = {a: angles.shown_by.get(name, ()) for a, name in enumerate(angles.names)}
    shown = {a: [at[name] for name in pair] for a, pair in joints.items() if pair and set(pair) <= set(at)}
    off = np.zeros((len(track.frame), len(angles.names)))
    ends, pivots = np.array(list(shown.values()), dtype=np.intp).reshape(-1, 2).T
    length = np.linalg.norm(track.joint_positions[:, ends] - track.joint_positions[:, pivots], axis=-1)
    deviation = np.nan_to_num(track.joint_deviation[:, ends])
    off[:, list(shown)] = np.divide(deviation, length, out=np.zeros_like(length), where=length > 0.0)
    return off


def sliding_joints(run: Path) -> tuple[str, ...]:
    """The prismatic joints of the body in a run's folder; empty if it is missing."""
    return read_tracked_body(run).model.joints_of(TRANSLATION) if (run / MODEL_FILE).exists() else ()
