"""Runs on disk as `gepf track` writes them, with artificial poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gepf.common.arrays import Array, Indices
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.exports import export_run
from gepf.coordinator.results.angles import with_angles
from gepf.coordinator.results.track import (
    MODEL_FILE,
    TRACK_FILE,
    Track,
    TrackedBody,
    write_track,
    write_tracked_body,
)

RATE = 25.0


def swing(model: BodyModel, frames: int, seed: int = 0) -> Array:
    """Poses (F, D) that move every degree of freedom smoothly, within its limits, two metres away."""
    rng = np.random.default_rng(seed)
    farthest = np.where(model.kinds == ROTATION, 2.5, 0.3)[:, None]
    limits = np.clip(model.limits, -farthest, farthest)
    middle, reach = limits.mean(axis=1), 0.5 * np.ptp(limits, axis=1)
    phase = rng.uniform(0.0, 2.0 * np.pi, len(middle))
    poses: Array = middle + reach * np.sin(phase + np.linspace(0.0, 2.0, frames)[:, None])
    if set(ROOT_DOFS) <= set(model.dof_names):
        poses[:, model.dof("root_tz")] += 2.0
    return poses


def make_track(
    model: BodyModel, poses: Array, held: Mapping[str, float] | None = None, **changes: Any
) -> Track:
    """A track of poses (F, D) with their angles, one hypothesis a frame, all tracked; but for `changes`.

    How far joints may be off is not known.
    """
    count = len(poses)
    unknown = np.full((count, len(model.joint_names)), np.nan)
    track = Track(
        frame=np.arange(count),
        time_s=np.arange(count) / RATE,
        dof_names=model.dof_names,
        pose=poses,
        joint_names=model.joint_names,
        joint_positions=joint_positions(model, poses),
        joint_deviation=unknown,
        joint_off_probability=unknown,
        joint_seen=unknown,
        hypothesis_pose=poses[:, None],
        hypothesis_weight=np.ones((count, 1)),
        status=np.array(["tracked"] * count),
        angle_names=(),
        angle=np.empty((count, 0)),
        angle_deviation=np.empty((count, 0)),
    )
    track = replace(track, **changes)
    return replace(with_angles(track, angles_of(model, held or {}, track.up)), **changes)


def write_run(
    folder: Path,
    model: BodyModel,
    poses: Array,
    lost: tuple[int, ...] = (),
    held: Mapping[str, float] | None = None,
    frames: Indices | None = None,
    up: Array | None = None,
    status: str = "lost",
    times: Array | None = None,
) -> Track:
    """A run's folder with these poses (F, D); one hypothesis a frame; `frames` (F,) count from 100.

    `up` (3,) leads away from the ground, camera frame. Frames that are `lost` have this status. Without
    `times` (F,) in seconds, frames have the RATE.
    """
    folder.mkdir(parents=True)
    count = len(poses)
    numbers = 100 + (np.arange(count, dtype=np.int64) if frames is None else frames)
    statuses = np.array([status if f in lost else "tracked" for f in range(count)])
    seconds = numbers / RATE if times is None else times
    track = make_track(model, poses, held, frame=numbers, time_s=seconds, status=statuses, up=up)
    with (folder / TRACK_FILE).open("wb") as file:
        write_track(track, file)
    with (folder / MODEL_FILE).open("wb") as file:
        write_tracked_body(TrackedBody(model, held or {}), file)
    return track


def write_and_export(
    folder: Path, form: str, model: BodyModel, frames: int, lost: tuple[int, ...] = ()
) -> tuple[Track, Path]:
    """A run in a folder of a body that swings, and the file that it is exported to."""
    track = write_run(folder / "run", model, swing(model, frames), lost)
    export_run(folder / "run", form, folder / f"run.{form}")
    return track, folder / f"run.{form}"
