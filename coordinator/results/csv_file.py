"""A track as comma-separated values (`poses.csv`): one line per frame, for spreadsheets and data frames.

Angles are first, in degrees and with plain names. The pose of the tracker, in radians, is last.
"""

from __future__ import annotations

import csv
import io
from typing import BinaryIO

import numpy as np

from gepf.common.arrays import Array
from gepf.coordinator.bodies.human.isb import isb_angles, isb_names
from gepf.coordinator.results.track import Track

Columns = dict[str, Array]


def write_csv(track: Track, file: BinaryIO) -> None:
    """Frame, time and status, then the columns of `angle_columns`, `joint_columns`, and the pose.

    Numbers are written so that reading them gives the same float64.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["frame", "time_s", "status", *columns_of(track.part(slice(0, 0)))])
    for part in track.parts(4096):  # frames in memory at once
        values = np.stack(list(columns_of(part).values()), axis=1)
        for f, frame in enumerate(part.frame.tolist()):
            writer.writerow([frame, float(part.time_s[f]), part.status[f], *values[f].tolist()])
    text.detach()


def columns_of(track: Track) -> Columns:
    """All columns (F,) of numbers by name."""
    return angle_columns(track) | joint_columns(track) | named(track.dof_names, track.pose)


def angle_columns(track: Track) -> Columns:
    """Angles (F,) in degrees, the ISB's shoulder angles, and the deviations of the angles."""
    angles = named(track.angle_names, track.angle)
    off = named(track.angle_names, track.angle_deviation)
    isb = named(isb_names(track.angle_names), isb_angles(track.angle_names, track.angle))
    columns = angles | isb | {f"{name}_deviation": values for name, values in off.items()}
    return {f"{name}_deg": np.degrees(values) for name, values in columns.items()}


def named(names: tuple[str, ...], values: Array) -> Columns:
    """Columns (F,) of values (F, N) by their names."""
    return dict(zip(names, values.T, strict=True))


def joint_columns(track: Track) -> Columns:
    """x, y, z (F,) and deviation of every joint, metres, camera frame; off-probability, visible share."""
    columns: Columns = {}
    for j, name in enumerate(track.joint_names):
        columns |= {f"{name}_{axis}": track.joint_positions[:, j, a] for a, axis in enumerate("xyz")}
    for what in ("deviation", "off_probability", "seen"):
        names = tuple(f"{name}_{what}" for name in track.joint_names)
        columns |= named(names, getattr(track, f"joint_{what}"))
    return columns
