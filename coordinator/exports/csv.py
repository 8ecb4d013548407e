"""Comma-separated values: one line a frame, for spreadsheets and data frames."""

from __future__ import annotations

import csv
import io
from typing import BinaryIO

from coordinator.results.track import Track


def write_csv(track: Track, file: BinaryIO) -> None:
    """Frame, time, status, every degree of freedom (metres, radians), every joint's x, y, z (metres).

    Numbers are written so that reading them gives the same float64.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    writer = csv.writer(text, lineterminator="\n")
    joints = [f"{name}_{axis}" for name in track.joint_names for axis in "xyz"]
    writer.writerow(["frame", "time_s", "status", *track.dof_names, *joints])
    for f, frame in enumerate(track.frame.tolist()):
        pose, places = track.pose[f].tolist(), track.joint_positions[f].ravel().tolist()
        writer.writerow([frame, float(track.time_s[f]), track.status[f], *pose, *places])
    text.detach()
