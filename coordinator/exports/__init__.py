"""Poses out, one file a format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from common.errors import InputError
from coordinator.exports.bap import write_bap
from coordinator.exports.bvh import write_bvh
from coordinator.exports.csv import write_csv
from coordinator.exports.gltf import write_glb, write_gltf
from coordinator.exports.json import write_json
from coordinator.exports.recorded import RecordedRun, read_run
from coordinator.exports.trc import write_trc
from coordinator.files.atomic import write_atomically

Export = Callable[[RecordedRun, BinaryIO], None]

EXPORTS: dict[str, Export] = {
    "bap": write_bap,
    "bvh": write_bvh,
    "csv": lambda run, file: write_csv(run.track, file),
    "glb": write_glb,
    "gltf": write_gltf,
    "json": lambda run, file: write_json(run.track, file),
    "trc": write_trc,
}


def export_run(folder: Path, form: str, path: Path) -> None:
    """Write a run in the format named `form`; InputError names the valid choices."""
    if form not in EXPORTS:
        raise InputError(f"unknown format '{form}'; choose from {', '.join(EXPORTS)}")
    run = read_run(folder)
    try:
        write_atomically(path, lambda file: EXPORTS[form](run, file))
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}; choose another --out") from error
