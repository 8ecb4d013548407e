"""Named numbers from a JSON file that people write by hand: faults name the entry."""

from __future__ import annotations

import json
import math
from pathlib import Path

from common.errors import InputError


def read_numbers(path: Path, remedy: str, entry: str) -> dict[str, float]:
    """The numbers of a file by name.

    Raises InputError for a file that cannot be read, which ends in `remedy`, and for what is no object of
    numbers; `entry` says how one entry is written, such as "degree of freedom: number".
    """
    try:
        content = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise InputError(f"no such file: {path}; {remedy}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; {remedy}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: {error}; write {{{entry}}}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path} holds no names with numbers; write {{{entry}}}")
    return {name: require_number(value, name, path) for name, value in content.items()}


def require_number(value: object, name: str, path: Path) -> float:
    """The value as a finite number; InputError that names it otherwise."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{path}: {name} is {json.dumps(value)[:40]}; give a finite number")
    return float(value)
