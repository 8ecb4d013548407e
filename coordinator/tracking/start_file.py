"""The pose to start from, as `init.json` holds it: {degree of freedom: metres or radians}."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from common.body import unknown_dof
from common.errors import InputError
from coordinator.files import read_numbers

FEW = 40  # degrees of freedom that fit into a line


def read_start(path: Path, dof_names: Collection[str], remedy: str = "") -> dict[str, float]:
    """Values by name; what is missing is zero. InputError names what the model does not know."""
    values = read_numbers(path, "give --init a file, or auto", "degree of freedom: number")
    for name in values:
        require_known(name, dof_names, str(path), remedy)
    return values


def require_known(name: str, dof_names: Collection[str], where: str, remedy: str = "") -> None:
    """InputError unless a body has this degree of freedom; it lists them all where they are few."""
    if name in dof_names:
        return
    if len(dof_names) <= FEW:
        known = ", ".join(dof_names)
        raise InputError(f"{where}: unknown degree of freedom '{name}'; choose from {known}{remedy}")
    raise InputError(f"{where}: {unknown_dof(name, dof_names)}{remedy}")
