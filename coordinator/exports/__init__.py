"""Exports of poses, one module per format."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import BinaryIO

from gepf.common.errors import check_choice
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
    "trc": "opensim.write_trc",
}
"""Format -> module and function that write it, loaded on first use."""


def export_run(
    folder: Path, form: str, path: Path, *, smooth_hz: float | None = None, force: bool = True
) -> RecordedRun:
    """Write a run in the format named `form` and return what was written.

    Args:
        folder: Folder of the run.
        form: One of `EXPORTS`; InputError lists them.
        path: File to write.
        smooth_hz: Cut-off frequency of a low-pass filter, Hz; None for the tracked values.
        force: Whether an existing file may be replaced; otherwise InputError.
    """
    check_choice("format", form, EXPORTS)
    require_new(path, force=force)
    run = read_run(folder, smooth_hz)
    module, _, name = EXPORTS[form].partition(".")
    write: Export = getattr(import_module(f"gepf.coordinator.exports.{module}"), name)
    write_atomically(path, lambda file: write(run, file))
    return run
