"""A person's measures as a file: what `gepf fit` writes and `--model` takes."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import msgspec

from common.errors import InputError
from coordinator.bodies.human.measures import REFERENCE_STATURE, Measures
from coordinator.files.atomic import write_atomically


def read_person(path: Path) -> Measures:
    """Measures in metres; what is missing follows from stature. InputError for what is no person's."""
    try:
        values = msgspec.convert(json.loads(path.read_bytes()), dict[str, float])
    except FileNotFoundError:
        raise InputError(f"no such file: {path}; gepf fit writes one") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; give --model another file") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: {error}; write {{measure: metres}}") from error
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
