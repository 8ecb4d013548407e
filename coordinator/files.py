"""Atomic writing of files, and checked reading."""

from __future__ import annotations

import codecs
import json
import os
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, TypeVar, get_type_hints
from zipfile import BadZipFile

import msgspec
import numpy as np
from numpy.typing import NDArray

from gepf.common.errors import InputError

T = TypeVar("T")

CAMERA_FILE = "camera_intrinsic.json"
TRUTH_FILE = "truth.npz"
START_FILE = "init.json"
SUMMARY_FILE = "summary.json"

MARKS = (codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
"""Byte order marks, as Windows' editors and shells write them."""

LOG_FILE = "frames.log"
LIVE_FILE = "live.mcap"
FILM_FILE, SHEET_FILE, HYPOTHESES_FILE = "overlay.mp4", "sheet.png", "hypotheses.png"


def write_atomically(path: Path, write: Callable[[BinaryIO], object]) -> None:
    """Let `write` fill a temporary file, sync it, and rename it to `path`.

    InputError if the folder is missing or cannot be written.
    """
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with draft.open("wb") as file:
            write(file)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
        sync_folder(path.parent)
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError, PermissionError) as error:
        raise InputError(f"cannot write {path}: {error.strerror}; choose another path") from error
    finally:
        with suppress(OSError):
            draft.unlink()


def write_json(path: Path, content: object) -> None:
    """Write indented JSON."""
    text = msgspec.json.format(msgspec.json.encode(content), indent=2)
    write_atomically(path, lambda file: file.write(text + b"\n"))


def sync_folder(folder: Path) -> None:
    """Sync the entries of a folder."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


KINDS = {"names": "U", "texts": "U", "whole numbers": "iu", "numbers": "iuf", "raw numbers": "iuf"}
"""The value types that a layout can name, and the kinds of numpy dtypes that each accepts."""

READ_AS = {"whole numbers": np.int64, "numbers": np.float64}


def file_layout(record: type) -> dict[str, str]:
    """The layout of a file whose arrays are the fields of a class, from the annotations of these fields."""
    hints = get_type_hints(record, include_extras=True)
    return {name: hint.__metadata__[0] for name, hint in hints.items()}


def read_arrays(path: Path, layout: Mapping[str, str] | None = None) -> dict[str, NDArray[Any]]:
    """The arrays of an `.npz` file by name; with a layout, only those that it lists, each checked.

    For each name, a layout gives the type and the shape of the values, such as `numbers (F, J, 3)`. A letter
    stands for a length, which must be the same in all arrays. An array is optional if its entry starts with
    `?`. The values of an array of `names` must be distinct. Nothing is unpickled. InputError if the file is
    missing or damaged, or does not have the layout.
    """
    try:
        with path.open("rb") as opened:
            content = np.load(opened, allow_pickle=False)
            if isinstance(content, np.ndarray):
                raise InputError(f"{path} is a single array, not an .npz file; give an .npz file")
            arrays = {key: content[key] for key in content.files}
    except FileNotFoundError:
        raise InputError(f"no such file: {path}; check the path") from None
    except (IsADirectoryError, PermissionError) as error:
        raise InputError(f"cannot read {path}: {error.strerror}; check the path") from None
    except (OSError, ValueError, EOFError, KeyError, BadZipFile, zlib.error, NotImplementedError) as error:
        raise InputError(f"{path} is damaged or not an .npz file; create it again or give another") from error
    if layout is None:
        return arrays
    lengths: dict[str, int] = {}
    found = {}
    for name, form in layout.items():
        if name in arrays:
            found[name] = check_array(arrays[name], form.removeprefix("?"), lengths, f"{path}: '{name}'")
        elif not form.startswith("?"):
            held = ", ".join(sorted(arrays)) or "nothing"
            raise InputError(f"{path} has no array '{name}', only {held}; give a file that has it")
    return found


def check_array(array: NDArray[Any], form: str, lengths: dict[str, int], what: str) -> NDArray[Any]:
    """The checked array; numbers are converted to float64 or int64, except raw ones. Adds to `lengths`.

    Raises InputError, which starts with `what`, if it does not have this form.
    """
    kind, _, shape = form.rstrip(")").partition(" (")
    if array.dtype.kind not in KINDS[kind] and not (kind == "names" and not array.size):
        raise InputError(f"{what} must be {kind}, not {array.dtype}; write the file again")
    axes = [axis for axis in shape.split(", ") if axis]
    if array.ndim == len(axes):
        wanted = tuple(
            int(axis) if axis.isdigit() else lengths.setdefault(axis, length)
            for axis, length in zip(axes, array.shape, strict=True)
        )
    if array.ndim != len(axes) or array.shape != wanted:
        shape = ", ".join(str(lengths.get(axis, axis)) for axis in axes)
        raise InputError(f"{what} has shape {array.shape}, not ({shape}); write the file again")
    if kind == "names" and len(set(array.tolist())) < len(array):
        raise InputError(f"{what} must be distinct names; write the file again")
    return array.astype(READ_AS.get(kind, array.dtype), copy=False)


def read_json(path: Path, kind: type[T], mend: str, missing: str = "check the path") -> T:
    """The content of a JSON file, of this type.

    InputError for a missing, unreadable or damaged one; `missing` and `mend` say how to fix the first and the
    last.
    """
    try:
        return msgspec.json.decode(read_text(path), type=kind)
    except FileNotFoundError:
        raise InputError(f"no such file: {path}; {missing}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; change its permissions") from error
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"{path}: {error}; {mend}") from error


def read_text(path: Path) -> str:
    """The text of a file in UTF-8, or as its byte order mark says."""
    content = path.read_bytes()
    return content.decode(json.detect_encoding(content) if content.startswith(MARKS) else "utf-8")


def require_new(path: Path, *, force: bool) -> None:
    """InputError if a file exists and must not be replaced, or if its folder is missing."""
    if path.exists() and not force:
        raise InputError(f"{path} already exists; replace it with --force, or choose another name")
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise InputError(f"cannot write {path}: it is a folder, or its folder is missing; give another name")


def with_parent(out: Path) -> None:
    """Create the parent folder of `out`; InputError unless `out` is missing or an empty folder."""
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise InputError(f"'{out}' already exists and is not empty; choose another folder, or remove it")
        out.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot write to '{out}' ({error.strerror}); choose another folder") from error
