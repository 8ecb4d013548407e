"""Reading `.npz` files that people hand in: every fault becomes one line that says how to mend it."""

from __future__ import annotations

import zlib
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from common.errors import InputError


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
