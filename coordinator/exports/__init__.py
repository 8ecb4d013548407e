"""Exports of poses, one module per format."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import BinaryIO

import numpy as np

from gepf.common.errors import InputError, check_choice
from gepf.common.packages import needs
from gepf.coordinator.exports.recorded import RecordedRun, read_run
from gepf.coordinator.files import require_new, write_atomically

Export = Callable[[RecordedRun, BinaryIO], None]

EXPORTS = {
    "bvh": "bvh.write_bvh",
    "c3d": "c3d.write_c3d",
    "csv": "tables.export_csv",
    "glb": "gltf.write_glb",
    "gltf": "gltf.write_gltf",
    "json": "tables.export_json",
    "mot": "opensim.write_mot",
    "obj": "surface.write_obj",
    "pcd": "surface.write_pcd",
    "ply": "surface.write_ply",
    "trc": "opensim.write_trc",
    "xyz": "surface.write_xyz",
}
"""Format -> module and function that write it, loaded on first use."""

STILL = "surface"  # the module of the formats of one frame, which needs Open3D


def export_run(
    folder: Path,
    form: str,
    path: Path,
    *,
    frame: int | None = None,
    smooth_hz: float | None = None,
    force: bool = True,
) -> RecordedRun:
    """Write a run in the format named `form` and return what was written.

    Args:
        folder: Folder of the run.
        form: One of `EXPORTS`; InputError lists them.
        path: File to write.
        frame: Number of the frame, for formats of one frame; None for the first that is `tracked`.
        smooth_hz: Cut-off frequency of a low-pass filter, Hz; None for the tracked values.
        force: Whether an existing file may be replaced; otherwise InputError.
    """
    check_choice("format", form, EXPORTS)
    module, _, name = EXPORTS[form].partition(".")
    if frame is not None and module != STILL:
        raise InputError(f"{form} holds all frames, not frame {frame} alone; leave --frame out")
    require_new(path, force=force)
    run = read_run(folder, smooth_hz)
    with needs("open3d" if module == STILL else "coordinator", f"the format {form}"):
        write: Export = getattr(import_module(f"gepf.coordinator.exports.{module}"), name)
    if module == STILL:
        run = one_frame(run, frame)
    write_atomically(path, lambda file: write(run, file))
    return run


def one_frame(run: RecordedRun, number: int | None) -> RecordedRun:
    """The run with that frame only, or with the first that is `tracked`; InputError if there is none."""
    track = run.track
    wanted = track.status == "tracked" if number is None else track.frame == number
    if not (wanted & run.placed).any():
        what = "no frame is tracked" if number is None else f"frame {number} has no pose"
        placed = track.frame[run.placed]
        known = f"give --frame {placed[0]} to {placed[-1]}" if len(placed) else "track the recording again"
        raise InputError(f"{run.folder}: {what}; {known}")
    at = int(np.argmax(wanted & run.placed))
    return replace(run, track=track.part(slice(at, at + 1)), placed=run.placed[at : at + 1])
