"""Numba, with kernels that are compiled anew when the source of whatever they call has changed.

Numba keeps a compiled kernel for as long as its own file stays the same, though it holds what it calls from
other files, and their constants. Here it is kept for as long as all files of these packages stay the same
that its file imports, directly or through others. Import `numba` from here where kernels are compiled.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

__all__ = ["numba"]

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = "common|worker|coordinator|gepf"
IMPORT = re.compile(rf"^ *from ((?:{PACKAGES})[\w.]*) import (\([^)]*\)|[^\n#]+)", re.MULTILINE)


@cache
def imported_by(file: Path) -> frozenset[Path]:
    """Files of these packages that a file imports from."""
    found = set[Path]()
    for module, names in IMPORT.findall(file.read_text(encoding="utf-8")):
        place = ROOT.joinpath(*module.split("."))
        if place.is_dir():
            found.add(place / "__init__.py")
            found |= {place / f"{name}.py" for name in re.findall(r"\w+", names)}
        else:
            found.add(place.with_suffix(".py"))
    return frozenset(path for path in found if path.is_file())


@cache
def content(file: Path) -> bytes:
    """A hash of what stands in a file."""
    return hashlib.sha256(file.read_bytes()).digest()


@cache
def sources(file: Path) -> bytes:
    """A hash of a file and of all that it imports, directly or through others."""
    known, unread = {file}, [file]
    while unread:
        new = imported_by(unread.pop()) - known
        known |= new
        unread += new
    return hashlib.sha256(b"".join(content(each) for each in sorted(known))).digest()


class BySources:
    """A kernel is as old as all the sources that it may stand on."""

    _py_file: str

    def get_source_stamp(self) -> Any:
        return sources(Path(self._py_file).resolve())


class InFolder(BySources, caching.UserProvidedCacheLocator):
    """Kept in the folder that NUMBA_CACHE_DIR names."""


class InTree(BySources, caching.InTreeCacheLocator):
    """Kept beside the source."""


class InHome(BySources, caching.UserWideCacheLocator):
    """Kept in the user's cache, where the source's folder cannot be written to."""


ours = [f"{each.__module__}.{each.__name__}" for each in (InFolder, InTree, InHome)]
setattr(numba.config, "CACHE_LOCATOR_CLASSES", ",".join([*ours, "IPythonCacheLocator", "ZipCacheLocator"]))  # noqa: B010
