"""Values as text for spreadsheets and programs: CSV, with one line per frame, and JSON."""

from __future__ import annotations

from dataclasses import fields
from typing import BinaryIO

import msgspec
import numpy as np

from gepf.coordinator.exports.recorded import RecordedRun
from gepf.coordinator.results.csv_file import write_csv
from gepf.coordinator.results.track import Track


def export_csv(run: RecordedRun, file: BinaryIO) -> None:
    """Write the CSV of a run."""
    write_csv(run.told, file)


def export_json(run: RecordedRun, file: BinaryIO) -> None:
    """Write one object with the keys of `track.npz`, null for padding, and whether the run is filtered."""
    values = {field.name: getattr(run.told, field.name) for field in fields(Track)}
    content: dict[str, object] = {name: np.asarray(value).tolist() for name, value in values.items()}
    if run.smoothed_hz:
        content["smoothed_hz"] = run.smoothed_hz
    file.write(msgspec.json.encode(content))
