"""Errors of a track against ground truth.

Angles are compared if track and truth both have the degree of freedom; the error is at most half a turn.
Joints are compared if both have one of this name. Truth that is not finite is unknown and is not used.
Angles of people's limbs are also compared with those of the true joints, since many truths have only joints.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import ROOT_DOFS
from gepf.common.camera import NOT_MOVED, moved
from gepf.common.errors import InputError
from gepf.coordinator.bodies.human.from_joints import angles_from_joints
from gepf.coordinator.files import file_layout, read_arrays
from gepf.coordinator.results.track import Track


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True joints, and poses if known, of F frames; NaN if unknown. Metres and radians, camera frame.

    Each field has the layout of its array in a file.
    """

    frame: Annotated[Indices, "?whole numbers (F)"]
    joint_names: Annotated[tuple[str, ...], "names (J)"]
    joint_positions: Annotated[Array, "numbers (F, J, 3)"]
    dof_names: Annotated[tuple[str, ...], "?names (D)"]  # empty if the pose is unknown
    pose: Annotated[Array, "?numbers (F, D)"]
    slides: Annotated[tuple[str, ...], "?names (S)"] = ROOT_DOFS[:3]  # what is not an angle


def read_truth(path: Path, placed: Array = NOT_MOVED) -> Truth:
    """Read a truth file; without `frame`, its rows are the frames from 0. InputError for any other file.

    Joints are moved by the transform `placed` (4, 4), as from the camera of the file into the rig.
    """
    arrays = read_arrays(path, file_layout(Truth))
    if "dof_names" in arrays and "pose" not in arrays:
        raise InputError(f"{path} has no 'pose', but dof_names; give both or neither")
    names = ("joint_names", "dof_names", "slides")
    joint_names, dof_names, slides = (tuple(arrays.get(name, np.empty(0)).tolist()) for name in names)
    joints = arrays["joint_positions"]
    pose = arrays["pose"] if dof_names else np.empty((len(joints), 0))
    for values in (joints, pose):
        values[~np.isfinite(values)] = np.nan
    frame = arrays.get("frame", np.arange(len(joints)))
    return Truth(frame, joint_names, moved(joints, placed), dof_names, pose, ROOT_DOFS[:3] + slides)


class Thresholds(msgspec.Struct, frozen=True):
    """Which errors count."""

    near_m: float = 0.10  #: of a joint that is right
    lost_m: float = 0.30  #: of a joint that is lost
    lost_deg: float = 30.0  #: the same of an angle


THRESHOLDS = Thresholds()


class Evaluation(msgspec.Struct, frozen=True):
    """Errors over all frames that track and truth have in common; None if the truth lacks the data."""

    frames: int
    mean_angle_error_deg: float | None  # of the reported pose
    mean_angle_error_deg_by_dof: dict[str, float] | None
    best_hypothesis_angle_error_deg: float | None  # of the hypothesis nearest to the truth in each frame
    best_hypothesis_angle_error_deg_by_dof: dict[str, float] | None
    mean_angle_error_deg_by_angle: dict[str, float] | None  # of limbs, compared with those of the true joints
    worst_angle_error_deg_by_angle: dict[str, float] | None
    mean_joint_error_cm: float | None
    pck10: float | None  # share of joints within 10 cm
    within_deviation: float | None  # share of joints with an error below `joint_deviation`
    within_two_deviations: float | None  # or below twice of it; 0.68 and 0.95 are expected
    lost_from_frame: int | None  # from here to the end the mean error stays above 30 degrees or 30 cm


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors of F frames; NaN if the truth is unknown."""

    frame: Indices  # (F,)
    dof_names: tuple[str, ...]  # (A,) the compared angles
    angle_deg: Array  # (F, A) of the reported pose
    best_angle_deg: Array  # (F, A) of the best hypothesis
    joint_m: Array  # (F, J)
    joint_deviation_m: Array = field(default_factory=lambda: np.empty((0, 0)))  # as joint_m, expected


def evaluate(track: Track, truth: Truth) -> Evaluation:
    """Score a track; InputError if it has no frame, or no angle and no joint, in common with the truth."""
    errors, limbs = measure_errors(track, truth), errors_by_angle(track, truth)
    moves = errors.joint_deviation_m > 0.0  # other joints are held, at any distance from the truth
    off = errors.joint_m / np.where(moves, errors.joint_deviation_m, np.nan)
    return Evaluation(
        frames=len(errors.frame),
        mean_angle_error_deg=overall(errors.angle_deg),
        mean_angle_error_deg_by_dof=by_dof(errors.dof_names, errors.angle_deg),
        best_hypothesis_angle_error_deg=overall(errors.best_angle_deg),
        best_hypothesis_angle_error_deg_by_dof=by_dof(errors.dof_names, errors.best_angle_deg),
        mean_angle_error_deg_by_angle={name: float(off.mean()) for name, off in limbs.items()} or None,
        worst_angle_error_deg_by_angle={name: float(off.max()) for name, off in limbs.items()} or None,
        mean_joint_error_cm=overall(errors.joint_m * 100.0),
        pck10=share_within(errors.joint_m, THRESHOLDS.near_m),
        within_deviation=share_within(off, 1.0),
        within_two_deviations=share_within(off, 2.0),
        lost_from_frame=lost_from(errors),
    )


def measure_errors(track: Track, truth: Truth) -> Errors:
    """Errors of each frame, for angles and joints that both have."""
    frame, mine, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)
    if not len(frame):
        raise InputError(
            f"the track ({span(track.frame)}) and the truth ({span(truth.frame)}) have no frame in common; "
            "give the truth of the tracked sequence"
        )
    angles = tuple(n for n in track.dof_names if n in truth.dof_names and n not in truth.slides)
    joints = tuple(n for n in track.joint_names if n in truth.joint_names)
    if not angles and not joints:
        raise InputError(
            "the truth has no angle or joint of the track; use the same names in both, or give another truth"
        )
    my_angles, my_joints = positions(track.dof_names, angles), positions(track.joint_names, joints)
    true_angles = truth.pose[theirs][:, positions(truth.dof_names, angles)]
    true_joints = truth.joint_positions[theirs][:, positions(truth.joint_names, joints)]
    return Errors(
        frame=frame,
        dof_names=angles,
        angle_deg=angle_error_deg(track.pose[mine][:, my_angles], true_angles),
        best_angle_deg=best_hypothesis(track.hypothesis_pose[mine][:, :, my_angles], true_angles),
        joint_m=np.linalg.norm(track.joint_positions[mine][:, my_joints] - true_joints, axis=-1),
        joint_deviation_m=track.joint_deviation[mine][:, my_joints],
    )


def errors_by_angle(track: Track, truth: Truth) -> dict[str, Array]:
    """Errors (K,) in degrees of each angle of a person's limbs, over the frames in which both are known.

    The true angles follow from the true joints; angles without these joints are omitted.
    """
    _, mine, theirs = np.intersect1d(track.frame, truth.frame, return_indices=True)
    true = angles_from_joints(truth.joint_names, truth.joint_positions[theirs])
    names = tuple(name for name in track.angle_names if name in true)
    off = {n: angle_error_deg(track.angle[mine, track.angle_names.index(n)], true[n]) for n in names}
    return {name: known for name, errors in off.items() if len(known := errors[np.isfinite(errors)])}


def best_hypothesis(poses: Array, truth: Array) -> Array:
    """Errors (F, A) in degrees of the hypothesis of poses (F, M, A) nearest to truth (F, A) in each frame."""
    errors = angle_error_deg(poses, truth[:, None])  # (F, M, A)
    if not errors.size:
        return np.full(truth.shape, np.nan)
    mean = known_mean(errors, axis=2)
    best = np.argmin(np.where(np.isnan(mean), np.inf, mean), axis=1)
    return np.take_along_axis(errors, best[:, None, None], axis=1)[:, 0]


def angle_error_deg(angles: Array, truth: Array) -> Array:
    """Absolute difference of angles in degrees, 0 to 180."""
    return np.abs((np.rad2deg(angles - truth) + 180.0) % 360.0 - 180.0)


def lost_from(errors: Errors) -> int | None:
    """First frame from which tracking is lost until the end; unknown frames are ignored."""
    angle, joint = known_mean(errors.angle_deg, axis=1), known_mean(errors.joint_m, axis=1)
    known = ~(np.isnan(angle) & np.isnan(joint))
    return to_the_end(
        errors.frame[known], ((angle > THRESHOLDS.lost_deg) | (joint > THRESHOLDS.lost_m))[known]
    )


def to_the_end(frames: Indices, lost: Mask) -> int | None:
    """The first of `frames` (F,) from which all are `lost` (F,); None if the last frame is not lost."""
    first = np.flatnonzero(~lost).max(initial=-1) + 1
    return int(frames[first]) if first < len(lost) else None


def overall(errors: Array) -> float | None:
    """Mean of the known values."""
    known = errors[~np.isnan(errors)]
    return float(known.mean()) if len(known) else None


def by_dof(names: tuple[str, ...], errors: Array) -> dict[str, float] | None:
    """Mean error of each angle that is known in any frame."""
    means = {name: overall(errors[:, a]) for a, name in enumerate(names)}
    return {name: mean for name, mean in means.items() if mean is not None} or None


def share_within(errors: Array, limit: float) -> float | None:
    """Share of the known errors that are at most `limit`."""
    return overall(np.where(np.isnan(errors), np.nan, errors <= limit))


def known_mean(values: Array, axis: int) -> Array:
    """Mean of the known values along an axis; NaN if there are none."""
    return np.asarray(np.ma.masked_invalid(values).mean(axis=axis).filled(np.nan))


def positions(names: tuple[str, ...], wanted: tuple[str, ...]) -> list[int]:
    """Index of each wanted name."""
    return [names.index(name) for name in wanted]


def span(frames: Indices) -> str:
    """First and last frame, as text."""
    return f"frames {frames.min()} to {frames.max()}" if len(frames) else "no frames"
