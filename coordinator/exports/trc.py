"""Track row column: the named joints as markers, for OpenSim.

Millimetres, OpenSim's axes: y up, and a person who faces the camera looks along +x, their right at +z; the
origin is the camera's. Lost frames keep their time and have no coordinates, which means missing markers.
"""

from __future__ import annotations

import io
from typing import BinaryIO

from coordinator.exports.recorded import MILLIMETRES, RecordedRun

HEAD = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame",
        "OrigNumFrames")  # fmt: skip


def write_trc(run: RecordedRun, file: BinaryIO) -> None:
    """One line a frame: its number from 1, its time in seconds, and x, y, z of every joint."""
    names, frames, rate = run.track.joint_names, len(run.track.frame), f"{run.rate:.6g}"
    values = [rate, rate, str(frames), str(len(names)), "mm", rate, "1", str(frames)]
    axes = [f"{axis}{j}" for j in range(1, len(names) + 1) for axis in "XYZ"]
    text = io.TextIOWrapper(file, encoding="utf-8", newline="\n")
    for cells in (
        ["PathFileType", "4", "(X/Y/Z)", f"{run.name}.trc"],
        HEAD,
        values,
        ["Frame#", "Time", *(f"{name}\t\t" for name in names)],
        ["", "", *axes],
        [],
    ):
        text.write("\t".join(cells) + "\n")
    places = run.track.joint_positions @ run.to_opensim.T * MILLIMETRES
    for f in range(frames):
        markers = [] if run.lost[f] else [f"{value:.4f}" for value in places[f].ravel()]
        markers = markers or [""] * places[f].size
        text.write("\t".join([str(f + 1), f"{run.track.time_s[f]:.6f}", *markers]) + "\n")
    text.detach()
