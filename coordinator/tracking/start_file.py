"""The pose to start from, as `init.json` holds it: {degree of freedom: metres or radians}."""

from __future__ import annotations

import json
import math
from collections.abc import Collection
from pathlib import Path

import msgspec

from common.body import unknown_dof
from common.errors import InputError


def read_start(path: Path, dof_names: Collection[str]) -> dict[str, float]:
    """Values by name; what is missing is zero. InputError names what the model does not know."""
    try:
        values = msgspec.convert(json.loads(path.read_bytes()), dict[str, float])
    except FileNotFoundError:
        raise InputError(f"no such file: {path}; give --init a file, or auto") from None
    except OSError as error:
        raise InputError(
            f"cannot read {path}: {error.strerror}; give --init another file, or auto"
        ) from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: {error}; write {{degree of freedom: number}}") from error
    for name, value in values.items():
        if name not in dof_names:
            raise InputError(f"{path}: {unknown_dof(name, dof_names)}")
        if not math.isfinite(value):
            raise InputError(f"{path}: {name} is {value}; give a finite number")
    return values
