"""Files that a user names for results."""

from __future__ import annotations

from pathlib import Path

from common.errors import InputError


def require_new(path: Path, *, force: bool) -> None:
    """InputError where a file is there that was not said to be replaced, or where its folder is not."""
    if path.exists() and not force:
        raise InputError(f"{path} is there already; replace it with --force, or choose another name")
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(f"cannot write {path}: its folder is not there; choose another name")
