"""The pose to start from, as `init.json` holds it: {degree of freedom: metres or radians}."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from common.body import unknown_dof
from common.errors import InputError
from coordinator.files.numbers import read_numbers


def read_start(path: Path, dof_names: Collection[str]) -> dict[str, float]:
    """Values by name; what is missing is zero. InputError names what the model does not know."""
    values = read_numbers(path, "give --init a file, or auto", "degree of freedom: number")
    for name in values:
        if name not in dof_names:
            raise InputError(f"{path}: {unknown_dof(name, dof_names)}")
    return values
