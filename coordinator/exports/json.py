"""JSON: the same fields as `track.npz`, for programs that do not read numpy's files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import BinaryIO

import msgspec
import numpy as np

from coordinator.exports.recorded import RecordedRun
from coordinator.results.track import Track


def export_json(run: RecordedRun, file: BinaryIO) -> None:
    """A run's JSON; a low-passed one says so."""
    write_json(run.told, file, {"smoothed_hz": run.smoothed_hz} if run.smoothed_hz else {})


def write_json(track: Track, file: BinaryIO, more: Mapping[str, object]) -> None:
    """One object with the keys of `track.npz`; the padding of hypotheses is null."""
    content: dict[str, object] = {
        field.name: np.asarray(getattr(track, field.name)).tolist() for field in fields(Track)
    }
    file.write(msgspec.json.encode({**content, **more}))
