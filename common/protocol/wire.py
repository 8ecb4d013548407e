"""The form of every message: a msgpack map with a protocol version, limited in size, and the arrays in it.

An array is (dtype, shape, bytes), little-endian, and is checked before anything is allocated. All that a
message is refused for is a ProtocolError that says what is wrong.
"""

from __future__ import annotations

import math
from functools import lru_cache, reduce
from operator import or_
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args

import msgpack  # type: ignore[import-untyped]
import msgspec
import numpy as np
from numpy.typing import NDArray

from common.errors import ProtocolError, VersionError

PROTOCOL = 9  # version of the messages between coordinator and workers
LIVE = 1  # version of the messages of cameras, which other programs write, too: docs/live.md
MAX_BYTES = 64 * 2**20  # of one message

DType = Literal["|u1", "<u2", "<u4", "<i8", "<f4", "<f8"]
Extent = Annotated[int, msgspec.Meta(ge=0, lt=2**31)]
Natural = Annotated[int, msgspec.Meta(ge=0, lt=2**53)]
Hash = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]
Dims = tuple[int | str, ...]  # extents: a number, or a letter that has one value throughout a message
NATIVE = {name: np.dtype(name).newbyteorder("=") for name in get_args(DType)}


class Array(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """An array in a message; `data` is a view of the message, not a copy."""

    dtype: DType
    shape: Annotated[tuple[Extent, ...], msgspec.Meta(max_length=4)]
    data: memoryview


class Header(msgspec.Struct, frozen=True):
    """What every message of every version has."""

    version: int


class Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """A message of this version."""

    VERSION: ClassVar[int] = PROTOCOL
    version: int = PROTOCOL


HEADER = msgspec.msgpack.Decoder(Header)

M = TypeVar("M", bound=Message)


def encode(message: Message) -> bytes:
    """A message as bytes."""
    packed: bytes = msgpack.packb(msgspec.to_builtins(message, builtin_types=(memoryview,)))
    return packed


def decode(payload: bytes, *kinds: type[M]) -> M:
    """A message of one of the kinds, which share a version, or ProtocolError.

    It is unpacked and validated in one go: unpacked first, a hostile message of empty lists would take 60
    times its size in memory before it is refused.
    """
    if len(payload) > MAX_BYTES:
        raise ProtocolError(f"a message of {len(payload)} bytes is above the limit of {MAX_BYTES}")
    expected = kinds[0].VERSION
    try:
        version = HEADER.decode(payload).version
        if version != expected:
            raise VersionError(f"the message is of protocol version {version}, expected {expected}")
        message: M = decoder_of(kinds).decode(payload)
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        tags = " or ".join(str(kind.__struct_config__.tag) for kind in kinds)
        raise ProtocolError(f"not a {tags} message: {error}") from error
    return message


@lru_cache(maxsize=16)
def decoder_of(kinds: tuple[type[Message], ...]) -> msgspec.msgpack.Decoder[Any]:
    """Reads messages of these kinds."""
    either: Any = reduce(or_, kinds)
    return msgspec.msgpack.Decoder(either)


def pack(array: NDArray[Any]) -> Array:
    """An array for the wire."""
    wire = array.dtype.newbyteorder("<")
    little = np.ascontiguousarray(array, wire)
    data = little.data.cast("B") if little.size else memoryview(b"")
    return Array(wire.str, array.shape, data)  # type: ignore[arg-type]


def unpack(what: str, array: Array, dtype: str, dims: Dims, extents: dict[str, int]) -> NDArray[Any]:
    """A writable array of native byte order; `extents` holds the letters' values and learns new ones.

    Raises ProtocolError if dtype or shape are not the expected, or the bytes do not fill the shape.
    """
    if array.dtype != dtype:
        raise ProtocolError(f"{what} has dtype {array.dtype}, expected {dtype}")
    wanted = tuple(extents.get(dim, dim) if isinstance(dim, str) else dim for dim in dims)
    fits = len(wanted) == len(array.shape) and all(
        isinstance(want, str) or want == extent for want, extent in zip(wanted, array.shape, strict=True)
    )
    if not fits:
        raise ProtocolError(f"{what} has shape {array.shape}, expected ({', '.join(map(str, wanted))})")
    extents.update((want, n) for want, n in zip(wanted, array.shape, strict=True) if isinstance(want, str))
    expected = NATIVE[dtype].itemsize * math.prod(array.shape)
    if array.data.nbytes != expected:
        raise ProtocolError(
            f"{what} of shape {array.shape} has {array.data.nbytes} bytes, expected {expected}"
        )
    return np.ndarray(array.shape, dtype, array.data).astype(NATIVE[dtype])


def check_finite(what: str, array: NDArray[Any] | float) -> None:
    """ProtocolError if there is an infinity or something that is not a number."""
    if not np.all(np.isfinite(array)):
        raise ProtocolError(f"{what} holds values that are not finite")


def check_numbers(what: str, array: NDArray[Any]) -> None:
    """ProtocolError if there is something that is not a number; infinities pass."""
    if array.dtype.kind == "f" and np.any(np.isnan(array)):
        raise ProtocolError(f"{what} holds values that are not numbers")


def check_magnitude(what: str, array: NDArray[np.float64], largest: float) -> None:
    """ProtocolError if there is a value beyond plus or minus `largest`, or something that is no number."""
    if array.size and not np.abs(array).max() <= largest:  # nor for a NaN
        check_finite(what, array)
        raise ProtocolError(f"{what} holds values above {largest:g}")


def check_range(what: str, value: float, least: float, largest: float) -> None:
    """ProtocolError unless least <= value <= largest."""
    if not least <= value <= largest:
        raise ProtocolError(f"{what} is {value:g}, expected {least:g} to {largest:g}")


def check_indices(what: str, array: NDArray[Any], least: int, end: int) -> None:
    """ProtocolError unless least <= every index < end."""
    if array.size and (array.min() < least or array.max() >= end):
        raise ProtocolError(f"{what} points outside of {least}..{end - 1}")
