"""Numba, with kernels that are recompiled when the source of anything they call has changed.

Numba keeps a compiled kernel as long as its own file does not change, although the kernel includes functions
and constants of other files. Here a kernel is kept as long as no file of this package changes that its file
imports, directly or indirectly. Modules with kernels import `numba` from here. Kernels of other packages in
the same process use numba's own cache, or the one that the user configured.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

from gepf.common.errors import InputError

__all__ = ["numba"]

PACKAGE = Path(__file__).parents[1]
"""The folder of `gepf`. Links in it are not followed: in a checkout they lead to the folders beside it."""
IMPORT = re.compile(rf"^ *from ({PACKAGE.name}[\w.]*) import (\([^)]*\)|[^\n#]+)", re.MULTILINE)
SETTING = "CACHE_LOCATOR_CLASSES"


def is_ours(file: Path) -> bool:
    """Whether a file exists and belongs to this package."""
    return file.is_file() and file.is_relative_to(PACKAGE)


@cache
def imported_by(file: Path) -> frozenset[Path]:
    """Files of this package that a file imports."""
    found = set[Path]()
    for module, names in IMPORT.findall(file.read_text(encoding="utf-8")):
        place = PACKAGE.parent.joinpath(*module.split("."))
        if place.is_dir():
            found.add(place / "__init__.py")
            found |= {place / f"{name}.py" for name in re.findall(r"\w+", names)}
        else:
            found.add(place.with_suffix(".py"))
    return frozenset(path for path in found if path.is_file())


@cache
def content(file: Path) -> bytes:
    """A hash of the content of a file."""
    return hashlib.sha256(file.read_bytes()).digest()


@cache
def sources(file: Path) -> bytes:
    """A hash of a file and of all its imports, direct and indirect."""
    known, unread = {file}, [file]
    while unread:
        new = imported_by(unread.pop()) - known
        known |= new
        unread += new
    return hashlib.sha256(b"".join(content(each) for each in sorted(known))).digest()


class BySources:
    """Cache locator that stamps a kernel with the state of all its sources.

    The stamp is part of the file names: Numba writes the index before the kernel, so if the process ended in
    between, an earlier kernel of the same name would be used. `make clean-kernels` removes earlier ones.
    """

    _py_file: str
    _lineno: int

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """The locator of a function; None if it is not ours, or its folder is not writable."""
        ours = is_ours(Path(py_file))
        return super().from_function(py_func, py_file) if ours else None  # type: ignore[misc]

    def get_source_stamp(self) -> Any:
        return sources(Path(self._py_file))

    def get_disambiguator(self) -> str:
        return f"{self._lineno}-{self.get_source_stamp().hex()[:16]}"


class InFolder(BySources, caching.UserProvidedCacheLocator):
    """Cache in the folder of NUMBA_CACHE_DIR."""


class InTree(BySources, caching.InTreeCacheLocator):
    """Cache beside the source."""


class InHome(BySources, caching.UserWideCacheLocator):
    """Cache in the user's cache folder, if the source's folder is not writable."""


class Nowhere:
    """No folder is writable."""

    @classmethod
    def from_function(cls, _: object, py_file: str) -> None:
        """Raise InputError for one of our functions."""
        if is_ours(Path(py_file)):
            raise InputError(
                f"compiled kernels cannot be kept beside {py_file}; name a writable folder in NUMBA_CACHE_DIR"
            )


ours = [f"{each.__module__}.{each.__name__}" for each in (InFolder, InTree, InHome, Nowhere)]
usual = caching.CacheImpl._locator_classes
theirs = getattr(numba.config, SETTING) or ",".join(each.__name__ for each in usual)
setattr(numba.config, SETTING, ",".join([*ours, theirs]))
