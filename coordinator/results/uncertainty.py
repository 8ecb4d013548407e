"""How sure the tracker is of what it reports, angle by angle and joint by joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from coordinator.bodies.angles import Angles, is_person
from coordinator.bodies.levers import even_out, shown_by, weigh
from coordinator.filters.sighting import USUAL_INTERVAL
from coordinator.results.spread import UNSEEN, root_mean_square
from coordinator.results.track import Track, filled

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
