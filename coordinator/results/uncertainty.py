"""How sure the tracker is of what it reports, angle by angle and joint by joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS
from coordinator.bodies.angles import Angles, is_person
from coordinator.bodies.levers import weigh
from coordinator.results.track import Track, filled


def deviation(track: Track) -> NDArray[np.float64]:
    """Root mean square distance (F, D) of the hypotheses from the reported pose, by weight; metres, radians.

    Zero where a frame ended with one hypothesis: it says where else the body may be, not how exactly the
    reported pose is known.
    """
    away = track.hypothesis_pose - track.pose[:, None, :]
    turning = np.array([name not in ROOT_DOFS[:3] for name in track.dof_names])
    away[..., turning] = (away[..., turning] + np.pi) % (2.0 * np.pi) - np.pi
    weight = np.nan_to_num(track.hypothesis_weight)
    squares = np.einsum("fm,fmd->fd", weight, np.nan_to_num(away) ** 2)
    total = weight.sum(axis=1, keepdims=True)
    spread: NDArray[np.float64] = np.sqrt(squares / np.where(total > 0.0, total, 1.0))
    return spread


UNSEEN = 2.0
"""True errors are about so many times as large as the hypotheses' spread, since few particles are drawn: on
the same people 69 % of the joints lie within the deviation that follows, 96 % within twice of it."""


ANGLE_MISFIT = np.radians(8.0)
"""Radians that a person's angles lie off even where all hypotheses agree. With twice the hypotheses' spread,
73 % of elbow, knee, shoulder and hip angles of the same people lie within one deviation, 93 % within two."""


UNKNOWN = np.radians(60.0)
"""Deviation of a rotation that nothing shows: about that of any rotation within the arm's range."""


def with_angles(track: Track, angles: Angles) -> Track:
    """The track with its body's angles (F, A), and how far each may be off."""
    known = filled(track)
    spread = hypotheses_spread(known, angles, angles.measure(known.pose))
    reported = angles.follow(known.pose, agreement(spread))
    deviations = angle_deviation(known, angles, reported)
    reported[~track.placed] = np.nan
    return replace(track, angle_names=angles.names, angle=reported, angle_deviation=deviations)


def angle_deviation(track: Track, angles: Angles, reported: NDArray[np.float64]) -> NDArray[np.float64]:
    """Expected distance (F, A) of the reported angles from the true ones, one standard deviation, radians.

    Of a robot, whose measures are known, that of the hypotheses alone. NaN where the frame is unknown.
    """
    spread = hypotheses_spread(track, angles, reported)
    expected = np.hypot(misfit(track, angles, reported), UNSEEN * spread)
    expected[track.unknown] = np.nan
    return expected


def hypotheses_spread(track: Track, angles: Angles, about: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far the hypotheses' angles are from these (F, A), in the root mean square, radians."""
    frames, most, dofs = track.hypothesis_pose.shape
    known = np.isfinite(track.hypothesis_weight)
    poses = np.where(known[..., None], track.hypothesis_pose, track.pose[:, None]).reshape(-1, dofs)
    others = angles.near(angles.measure(poses), np.repeat(about, most, axis=0))
    squares = (others.reshape(frames, most, about.shape[1]) - about[:, None]) ** 2
    weight = np.where(known, track.hypothesis_weight, 0.0)
    mean = np.einsum("fm,fma->fa", weight, squares) / np.maximum(weight.sum(axis=1), 1e-300)[:, None]
    spread: NDArray[np.float64] = np.sqrt(mean)
    return spread


def agreement(spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much angles count whose hypotheses spread so far (F, A): 1 where they agree."""
    share: NDArray[np.float64] = ANGLE_MISFIT**2 / (ANGLE_MISFIT**2 + (UNSEEN * spread) ** 2)
    return share


def misfit(track: Track, angles: Angles, reported: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far angles (F, A) are off where all hypotheses agree; a rotation more, the straighter the arm."""
    off = np.full(reported.shape, ANGLE_MISFIT if is_person(track.dof_names) else 0.0)
    for twist, bend in angles.levers.items():
        off[:, twist] = np.minimum(
            ANGLE_MISFIT / np.sqrt(np.maximum(weigh(reported[:, bend]), 1e-9)), UNKNOWN
        )
    return off
