"""The angles of a track and the positions of its sliding joints, and how far each may be off."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, TRANSLATION, BodyModel
from coordinator.bodies.angles import Angles, is_person
from coordinator.bodies.levers import even_out, shown_by, weigh
from coordinator.filters.sighting import USUAL_INTERVAL
from coordinator.results.track import MODEL_FILE, Track, filled, read_tracked_body

Array = NDArray[np.float64]

UNSEEN = 2.0
"""True errors are about so many times as large as the hypotheses' spread, since few particles are drawn: on
the same people 69 % of the joints lie within the deviation that follows, 96 % within twice of it."""


def root_mean_square(away: Array, weight: Array) -> Array:
    """Of M hypotheses' distances `away` (F, M, C) from what is reported, by weight (F, M): (F, C).

    Zero where a frame ended with one hypothesis: it says where else the body may be, not how exactly the
    reported pose is known. Places without a hypothesis hold NaN.
    """
    weight = np.nan_to_num(weight)
    squares = np.einsum("fm,fmc->fc", weight, np.nan_to_num(away) ** 2)
    mean: Array = squares / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    return np.sqrt(mean)


SHORTEST_BONE = 0.1  # metres
SHORTEST = 1e-3  # seconds between frames

ANGLE_MISFIT = np.radians(5.0)
"""Radians that a person's angles lie off at the least, where joints are in place and all hypotheses agree.
With that, with how far off the joints are said to be and with twice the hypotheses' spread, 80 % of elbow,
knee, shoulder and hip angles of people with exact truth lie within one deviation, 98 % within two."""


UNKNOWN = np.radians(60.0)
"""Deviation of an angle that nothing shows: about that of any angle within a joint's range."""


def saying(track: Track, angles: Angles) -> Track:
    """The track with these angles and no others: those that it has, unless another version wrote it."""
    return track if track.angle_names == angles.names else with_angles(track, angles)


def with_angles(track: Track, angles: Angles) -> Track:
    """The track with its body's angles (F, A), and how far each may be off.

    A person's are evened out where they are not known (`coordinator.bodies.levers`).
    """
    known = filled(track)
    reported = angles.follow(known.pose, known.unknown)
    if is_person(track.dof_names) and len(known.frame) > 1:
        off = deviations(known, angles, reported, np.inf)
        off[known.unknown] = np.inf
        since = np.diff(known.time_s)
        interval = np.where(since > SHORTEST, since, USUAL_INTERVAL)
        beyond = np.maximum(off**2 - ANGLE_MISFIT**2, 0.0)
        columns = [even_out(*each, interval) for each in zip(reported.T, beyond.T, strict=True)]
        reported = np.array(columns).reshape(reported.T.shape).T
    expected = deviations(known, angles, reported, UNKNOWN)
    reported[~track.placed], expected[track.unknown] = np.nan, np.nan
    return replace(track, angle_names=angles.names, angle=reported, angle_deviation=expected)


def deviations(track: Track, angles: Angles, about: NDArray[np.float64], most: float) -> NDArray[np.float64]:
    """Expected distance (F, A) of these angles (F, A) from the true ones, one standard deviation, radians.

    Of a robot, whose measures are known, that of the hypotheses alone. What nothing shows is off by `most`.
    """
    spread = hypotheses_spread(track, angles, about)
    expected: NDArray[np.float64] = np.hypot(misfit(track, angles, about, most), UNSEEN * spread)
    return expected


def hypotheses_spread(track: Track, angles: Angles, about: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far the hypotheses' angles are from these (F, A), in the root mean square, radians."""
    away = hypotheses_near(track, angles, about) - about[:, None]
    return root_mean_square(away, track.hypothesis_weight)


def hypotheses_near(track: Track, angles: Angles, about: NDArray[np.float64]) -> NDArray[np.float64]:
    """The hypotheses' angles (F, M, A), radians, on the turns nearest to `about` (F, A); else NaN."""
    frames, most, dofs = track.hypothesis_pose.shape
    known = np.isfinite(track.hypothesis_weight)
    poses = np.where(known[..., None], track.hypothesis_pose, track.pose[:, None]).reshape(-1, dofs)
    others = angles.near(angles.measure(poses), np.repeat(about, most, axis=0))
    return np.where(known[..., None], others.reshape(frames, most, about.shape[1]), np.nan)


def misfit(track: Track, angles: Angles, about: NDArray[np.float64], most: float) -> NDArray[np.float64]:
    """How far angles (F, A) are off where all hypotheses agree; a rotation more, the straighter the arm."""
    if not is_person(track.dof_names):
        return np.zeros(about.shape)
    off = np.maximum(ANGLE_MISFIT, from_joints(track, angles))
    for twist, bend in angles.levers.items():
        off[:, twist] = off[:, twist] / np.sqrt(np.maximum(weigh(about[:, bend]), 1e-9))
    return np.minimum(off, most)


def from_joints(track: Track, angles: Angles) -> NDArray[np.float64]:
    """How far angles (F, A) are off by how far the joints are that show them, radians; 0 if nobody knows."""
    off = np.zeros((len(track.frame), len(angles.names)))
    if track.joint_deviation is None:
        return off
    for angle, (end, pivot) in shown_by(angles.names, track.joint_names).items():
        bone = track.joint_positions[:, end] - track.joint_positions[:, pivot]
        length = np.maximum(np.linalg.norm(bone, axis=-1), SHORTEST_BONE)
        off[:, angle] = np.nan_to_num(track.joint_deviation[:, end]) / length
    return off


@dataclass(frozen=True, slots=True, eq=False)
class Slides:
    """Sliding joints (S) over F frames, metres."""

    names: tuple[str, ...]
    value: Array  # (F, S) NaN before the body was found
    deviation: Array  # (F, S) one standard deviation; NaN where nobody knows


def read_slides(run: Path, track: Track) -> Slides:
    """Of the body in a run's folder; none where that is missing."""
    if not (run / MODEL_FILE).exists():
        return Slides((), np.empty((len(track.frame), 0)), np.empty((len(track.frame), 0)))
    return slides_of(track, read_tracked_body(run).model)


def slides_of(track: Track, model: BodyModel) -> Slides:
    """What of a track slides, but for the root's place; off by as much as angles for the same spread."""
    sliding = np.flatnonzero(model.kinds == TRANSLATION)
    names = tuple(name for j in sliding if (name := model.dof_names[j]) not in ROOT_DOFS)
    at = [track.dof_names.index(name) for name in names]
    value = track.pose[:, at]
    away = track.hypothesis_pose[:, :, at] - value[:, None]
    deviation = UNSEEN * root_mean_square(away, track.hypothesis_weight)
    deviation[track.unknown] = np.nan
    return Slides(names, value, deviation)
