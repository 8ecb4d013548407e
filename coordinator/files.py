"""Files that are whole or not there, what is read from files is checked, and names of files."""

from __future__ import annotations

import json
import math
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO
from zipfile import BadZipFile

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.errors import InputError

CAMERA_FILE = "camera_intrinsic.json"
TRUTH_FILE = "truth.npz"
START_FILE = "init.json"

LOG_FILE = "frames.log"
FILM_FILE, SHEET_FILE = "overlay.mp4", "sheet.png"
HYPOTHESES_FILE, ERRORS_FILE = "hypotheses.png", "errors.png"


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Let `write` fill a file beside `path`, make it durable, and put it in `path`'s place."""
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with draft.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
        sync_folder(path.parent)
    finally:
        draft.unlink(missing_ok=True)


def write_json(path: Path, content: object) -> None:
    """Write JSON that people can read."""
    text = msgspec.json.format(msgspec.json.encode(content), indent=2)
    write_atomically(path, lambda file: file.write(text + b"\n"))


def sync_folder(folder: Path) -> None:
    """Make durable which files a folder holds."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class ArrayFile:
    """The named arrays of one file. Each is checked for type and shape when it is taken."""

    def __init__(self, path: Path, content: dict[str, NDArray[np.generic]]) -> None:
        self.path = path
        self._content = content

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def any(self, key: str) -> NDArray[np.generic]:
        """An array of whatever kind and shape."""
        return self._take(key)

    def names(self, key: str) -> tuple[str, ...]:
        """A one-dimensional array of distinct texts; an empty one may be of any type."""
        array = self._take(key)
        texts = array.dtype.kind == "U" or not array.size
        if array.ndim != 1 or not texts or len(set(array.tolist())) < len(array):
            raise InputError(f"{self.path}: '{key}' must be a list of distinct names; write the file again")
        return tuple(array.tolist())

    def texts(self, key: str, shape: tuple[int, ...]) -> NDArray[np.str_]:
        """An array of texts."""
        array = self._take(key)
        if array.dtype.kind != "U":
            raise InputError(f"{self.path}: '{key}' must be text, not {array.dtype}; write the file again")
        return self._shaped(key, array, shape).astype(np.str_, copy=False)

    def floats(self, key: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """An array of numbers; -1 in `shape` stands for any length."""
        array = self._take(key)
        if array.dtype.kind not in "iuf":
            raise InputError(f"{self.path}: '{key}' must be numbers, not {array.dtype}; write the file again")
        return self._shaped(key, array, shape).astype(np.float64)

    def integers(self, key: str, shape: tuple[int, ...]) -> NDArray[np.int64]:
        """An array of whole numbers."""
        array = self._take(key)
        if array.dtype.kind not in "iu":
            raise InputError(
                f"{self.path}: '{key}' must be whole numbers, not {array.dtype}; write the file again"
            )
        return self._shaped(key, array, shape).astype(np.int64)

    def _take(self, key: str) -> NDArray[np.generic]:
        if key not in self._content:
            held = ", ".join(sorted(self._content)) or "nothing"
            raise InputError(f"{self.path} has no '{key}' but {held}; give a file that holds it")
        return self._content[key]

    def _shaped(self, key: str, array: NDArray[np.generic], shape: tuple[int, ...]) -> NDArray[np.generic]:
        fits = array.ndim == len(shape) and all(
            want in (-1, n) for want, n in zip(shape, array.shape, strict=True)
        )
        if not fits:
            wanted = ", ".join("any" if n < 0 else str(n) for n in shape)
            raise InputError(
                f"{self.path}: '{key}' has shape {array.shape}, not ({wanted}); write the file again"
            )
        return array


def read_arrays(path: Path) -> ArrayFile:
    """All arrays of an `.npz` file. Nothing is unpickled. InputError if it is missing or damaged."""
    try:
        with path.open("rb") as opened:
            content = np.load(opened, allow_pickle=False)
            if isinstance(content, np.ndarray):
                raise InputError(f"{path} is a single array, not an .npz file; give an .npz file")
            return ArrayFile(path, {key: content[key] for key in content.files})
    except FileNotFoundError:
        raise InputError(f"no such file: {path}; check the path") from None
    except (IsADirectoryError, PermissionError) as error:
        raise InputError(f"cannot read {path}: {error.strerror}; check the path") from None
    except (OSError, ValueError, EOFError, KeyError, BadZipFile, zlib.error, NotImplementedError) as error:
        raise InputError(f"{path} is damaged or no .npz file; make it again or give an .npz file") from error


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


def require_new(path: Path, *, force: bool) -> None:
    """InputError where a file is there that was not said to be replaced, or where its folder is not."""
    if path.exists() and not force:
        raise InputError(f"{path} is there already; replace it with --force, or choose another name")
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(f"cannot write {path}: its folder is not there; choose another name")
