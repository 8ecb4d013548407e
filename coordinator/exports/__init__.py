"""Poses out, one file a format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from common.errors import InputError
from coordinator.atomic_file import write_atomically
from coordinator.exports.csv import write_csv
from coordinator.exports.json import write_json
from coordinator.track import Track

Export = Callable[[Track, BinaryIO], None]

EXPORTS: dict[str, Export] = {"csv": write_csv, "json": write_json}


def export_track(track: Track, form: str, path: Path) -> None:
    """Write a track in the format named `form`; InputError names the valid choices."""
    if form not in EXPORTS:
        raise InputError(f"unknown format '{form}'; choose from {', '.join(EXPORTS)}")
    try:
        write_atomically(path, lambda file: EXPORTS[form](track, file))
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}; choose another --out") from error
