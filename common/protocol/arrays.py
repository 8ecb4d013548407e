"""Arrays on the wire: (dtype, shape, bytes), little-endian, checked before anything is allocated."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.errors import ProtocolError

DType = Literal["|u1", "<u2", "<u4", "<i8", "<f4", "<f8"]
Extent = Annotated[int, msgspec.Meta(ge=0, lt=2**31)]
Dims = tuple[int | str, ...]  # extents: a number, or a letter that has one value throughout a message
EMPTY = memoryview(b"")
TYPES = {name: (np.dtype(name), np.dtype(name).newbyteorder("=")) for name in get_args(DType)}


class Array(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """An array as it travels; `data` is a view of the message, not a copy."""

    dtype: DType
    shape: Annotated[tuple[Extent, ...], msgspec.Meta(max_length=4)]
    data: memoryview


def pack(array: NDArray[Any]) -> Array:
    """An array for the wire."""
    wire = array.dtype.newbyteorder("<")
    little = np.ascontiguousarray(array, wire)
    return Array(wire.str, array.shape, little.data.cast("B") if little.size else EMPTY)  # type: ignore[arg-type]


def unpack(what: str, array: Array, dtype: str, dims: Dims, sizes: dict[str, int]) -> NDArray[Any]:
    """A writable array of native byte order; `sizes` holds the letters' values and learns new ones.

    Raises ProtocolError if dtype or shape are not the expected, or the bytes do not fill the shape.
    """
    if array.dtype != dtype:
        raise ProtocolError(f"{what} has dtype {array.dtype}, expected {dtype}")
    check_shape(what, array.shape, dims, sizes)
    wire, native = TYPES[dtype]
    expected = wire.itemsize * math.prod(array.shape)
    if array.data.nbytes != expected:
        raise ProtocolError(
            f"{what} of shape {array.shape} has {array.data.nbytes} bytes, expected {expected}"
        )
    return np.ndarray(array.shape, wire, array.data).astype(native)


def check_shape(what: str, shape: tuple[int, ...], dims: Dims, sizes: dict[str, int]) -> None:
    """Compare a shape with the expected extents."""
    if shape == tuple(sizes.get(d) if isinstance(d, str) else d for d in dims):
        return
    wanted = tuple(d if isinstance(d, int) else sizes.get(d, d) for d in dims)
    if len(shape) != len(dims) or any(
        isinstance(w, int) and w != n for w, n in zip(wanted, shape, strict=True)
    ):
        named = ", ".join(str(w) for w in wanted)
        raise ProtocolError(f"{what} has shape {shape}, expected ({named})")
    sizes.update({d: n for d, n in zip(dims, shape, strict=True) if isinstance(d, str)})


def check_finite(what: str, array: NDArray[Any] | float) -> None:
    """ProtocolError if there is an infinity or something that is not a number."""
    if not np.all(np.isfinite(array)):
        raise ProtocolError(f"{what} holds values that are not finite")


def check_numbers(what: str, array: NDArray[Any]) -> None:
    """ProtocolError if there is something that is not a number; infinities pass."""
    if array.dtype.kind == "f" and np.any(np.isnan(array)):
        raise ProtocolError(f"{what} holds values that are not numbers")


def check_indices(what: str, array: NDArray[Any], least: int, end: int) -> None:
    """ProtocolError unless least <= every index < end."""
    if array.size and (array.min() < least or array.max() >= end):
        raise ProtocolError(f"{what} points outside of {least}..{end - 1}")
