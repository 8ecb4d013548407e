"""Numba, with kernels that are compiled anew when the source of whatever they call has changed.

Numba keeps a compiled kernel for as long as its own file stays the same, though it holds what it calls from
other files, and their constants. Here it is kept for as long as all files of these packages stay the same
that its file imports, directly or through others. Import `numba` from here where kernels are compiled. Those
of other packages in the same process are numba's own matter, or of whom the user names instead.
"""

from __future__ import annotations

import hashlib
import re
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching

from common.errors import InputError

__all__ = ["numba"]

PACKAGES = ("common", "worker", "coordinator", "gepf")
ROOT = Path(__file__).resolve().parents[1]
IMPORT = re.compile(rf"^ *from ((?:{'|'.join(PACKAGES)})[\w.]*) import (\([^)]*\)|[^\n#]+)", re.MULTILINE)
SETTING = "CACHE_LOCATOR_CLASSES"
USUAL = (
    "UserProvidedCacheLocator",
    "InTreeCacheLocator",
    "UserWideCacheLocator",
    "IPythonCacheLocator",
    "ZipCacheLocator",
)
"""Where numba keeps what others compile, in its own order."""


def is_ours(file: Path) -> bool:
    """Whether a file is there, and of these packages."""
    return file.is_file() and any(file.is_relative_to(ROOT / package) for package in PACKAGES)


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


@cache
def kept_in(folder: Path) -> tuple[Path, ...]:
    """Compiled kernels in a folder, as they were when it was first looked at."""
    return tuple(folder.glob("*.nb[ic]"))


class BySources:
    """A kernel of ours is as old as all the sources that it may stand on.

    Their state is in the names of its files: numba writes a kernel after the index that calls it current, and
    if it were ended in between, an earlier kernel of the same name would be taken for that.
    """

    _py_file: str
    _lineno: int

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """Where a function is kept; None if it is not ours, or that cannot be written to."""
        if not is_ours(Path(py_file).resolve()):
            return None
        found = super().from_function(py_func, py_file)  # type: ignore[misc]
        if found is not None:
            found.forget_earlier(f"{Path(py_file).stem}.{py_func.__qualname__}-")
        return found

    def get_source_stamp(self) -> Any:
        return sources(Path(self._py_file).resolve())

    def get_disambiguator(self) -> str:
        return f"{self._lineno}-{self.get_source_stamp().hex()[:16]}"

    def forget_earlier(self, name: str) -> None:
        """Remove a function's kernels of other states of the sources, whose files' names begin so."""
        current = f"{name}{self.get_disambiguator()}."
        for file in kept_in(Path(self.get_cache_path())):  # type: ignore[attr-defined]
            if file.name.startswith(name) and not file.name.startswith(current):
                with suppress(OSError):  # another process was faster, or it is somebody else's
                    file.unlink()


class InFolder(BySources, caching.UserProvidedCacheLocator):
    """Kept in the folder that NUMBA_CACHE_DIR names."""


class InTree(BySources, caching.InTreeCacheLocator):
    """Kept beside the source."""


class InHome(BySources, caching.UserWideCacheLocator):
    """Kept in the user's cache, where the source's folder cannot be written to."""


class Nowhere:
    """None of them can be written to."""

    @classmethod
    def from_function(cls, _: object, py_file: str) -> None:
        """InputError for a function of ours."""
        if is_ours(Path(py_file).resolve()):
            raise InputError(
                f"compiled kernels cannot be kept beside {py_file} or in this user's cache;"
                f" name a folder that can be written to in NUMBA_CACHE_DIR"
            )


ours = [f"{each.__module__}.{each.__name__}" for each in (InFolder, InTree, InHome, Nowhere)]
theirs = getattr(numba.config, SETTING) or ",".join(USUAL)
setattr(numba.config, SETTING, ",".join([*ours, theirs]))
