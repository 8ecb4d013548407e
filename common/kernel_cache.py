"""Where compiled kernels are kept: by an installed gepf in a folder for each state of its sources.

Numba keeps them beside their source, where an upgrade in place leaves those of the version before, which it
may be unable to read. A checkout keeps them there all the same: `make clean-kernels` forgets them.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

PACKAGES = ("common", "worker", "coordinator", "gepf")
VARIABLE = "NUMBA_CACHE_DIR"
LETTERS = 16  # of a hash


def keep_kernels_by_source(root: Path) -> None:
    """Have numba keep compiled kernels in a folder of their sources' state, unless the user names another.

    Must be called before numba is imported. `root` is the folder that holds the packages.
    """
    if VARIABLE in os.environ or (root / "pyproject.toml").exists():
        return
    os.environ[VARIABLE] = str(cache_folder() / f"kernels-{state_of(root)}")


def cache_folder() -> Path:
    """This user's folder for what can be made again."""
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "gepf"


def state_of(root: Path) -> str:
    """A hash of names, sizes and times of all source files."""
    state = hashlib.sha256()
    for file in sorted(file for package in PACKAGES for file in (root / package).rglob("*.py")):
        found = file.stat()
        state.update(f"{file.relative_to(root)} {found.st_size} {found.st_mtime_ns}\n".encode())
    return state.hexdigest()[:LETTERS]
