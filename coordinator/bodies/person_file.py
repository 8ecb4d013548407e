"""A person's measures as a file: what `gepf fit` writes and `--model` takes."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import msgspec

from common.errors import InputError
from coordinator.bodies.human.measures import REFERENCE_STATURE, Measures
from coordinator.files.atomic import write_atomically
from coordinator.files.numbers import read_numbers


def read_person(path: Path) -> Measures:
    """Measures in metres; what is missing follows from stature. InputError for what is no person's."""
    values = read_numbers(path, "gepf fit writes one for --model", "measure: metres")
    stature, girth = values.pop("stature", REFERENCE_STATURE), values.pop("girth", 1.0)
    try:
        return Measures.of(stature, girth, **values)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def write_person(measures: Measures, path: Path) -> None:
    """Write all measures, to a tenth of a millimetre."""
    rounded = {name: round(value, 4) for name, value in asdict(measures).items()}
    text = msgspec.json.format(msgspec.json.encode(rounded)) + b"\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, lambda file: file.write(text))
    except OSError as error:
        raise InputError(f"cannot write {path} ({error.strerror}); choose another place") from error
