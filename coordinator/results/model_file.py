"""The body that a run tracked, in its folder: what exports, viewers and comparisons need beside the poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.errors import InputError
from coordinator.files.arrays import ArrayFile, read_arrays

MODEL_FILE = "model.npz"
HASH, HELD_NAMES, HELD_VALUES = "hash", "held_names", "held_values"


@dataclass(frozen=True, slots=True, eq=False)
class TrackedBody:
    """A body with its active degrees of freedom, and where those that do not move are held.

    `held` is by name, in radians and metres; what neither moves nor is named is zero.
    """

    model: BodyModel
    held: Mapping[str, float]


def write_tracked_body(body: TrackedBody, file: BinaryIO) -> None:
    """Write the `.npz` form: the fields of `BodyModel` by name. Equal bodies give equal bytes."""
    values: dict[str, Any] = {f.name: np.asarray(getattr(body.model, f.name)) for f in fields(BodyModel)}
    held = {
        HELD_NAMES: np.array(list(body.held), dtype=np.str_),
        HELD_VALUES: np.array(list(body.held.values()), dtype=np.float64),
    }
    np.savez_compressed(file, allow_pickle=False, **{HASH: np.array(body.model.hash)}, **values, **held)


def read_tracked_body(folder: Path) -> TrackedBody:
    """The body of a run's folder; InputError if there is none or it is damaged."""
    path = folder / MODEL_FILE
    if not path.exists():
        raise InputError(f"{folder} holds no {MODEL_FILE}; track the sequence again with this version")
    arrays = read_arrays(path)
    try:
        values: dict[str, Any] = {f.name: field_of(arrays, f.name, str(f.type)) for f in fields(BodyModel)}
        model = BodyModel(**values)
    except ValueError as error:
        raise InputError(f"{path} contradicts itself ({error}); track the sequence again") from error
    if str(arrays.any(HASH)) != model.hash:
        raise InputError(f"{path} is not as it was written; track the sequence again")
    names = arrays.names(HELD_NAMES)
    held = arrays.floats(HELD_VALUES, (len(names),))
    return TrackedBody(model, dict(zip(names, held.tolist(), strict=True)))


def field_of(arrays: ArrayFile, name: str, kind: str) -> str | tuple[str, ...] | NDArray[np.generic]:
    """One field of a `BodyModel` in the type that it is declared with."""
    if kind == "str":
        return str(arrays.any(name))
    return arrays.names(name) if kind.startswith("tuple") else arrays.any(name)
