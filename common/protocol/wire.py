"""The format of all messages: a msgpack map with a protocol version and limited size, and its arrays.

An array is (dtype, shape, bytes), little-endian, and is checked before anything is allocated. An invalid
message raises a ProtocolError that says what is wrong.
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

from gepf.common.bounds import MAX_BYTES
from gepf.common.checks import check_range
from gepf.common.errors import ProtocolError, VersionError

PROTOCOL = 22  # version of messages and kernel, which coordinator and workers share
LIVE = 1  # version of frames and results of live input, which other programs also use: docs/live.md

DType = Literal["|u1", "<u2", "<u4", "<i8", "<f4", "<f8"]
Extent = Annotated[int, msgspec.Meta(ge=0, lt=2**31)]
Natural = Annotated[int, msgspec.Meta(ge=0, lt=2**53)]
Hash = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]
Dims = tuple[int | str, ...]  # extents: a number, or a letter with one value per message
NATIVE = {name: np.dtype(name).newbyteorder("=") for name in get_args(DType)}


class Array(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """An array in a message; `data` is a view of the message, not a copy."""

    dtype: DType
    shape: Annotated[tuple[Extent, ...], msgspec.Meta(max_length=4)]
    data: memoryview


class Header(msgspec.Struct, frozen=True):
    """The fields of every message of every version."""

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

    It is unpacked and validated in one pass. If it were unpacked first, a hostile message of empty lists
    would take 60 times its size in memory before it was refused.
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
    """A decoder of messages of these kinds."""
    either: Any = reduce(or_, kinds)
    return msgspec.msgpack.Decoder(either)


def pack(array: NDArray[Any]) -> Array:
    """An array as part of a message."""
    wire = array.dtype.newbyteorder("<")
    little = np.ascontiguousarray(array, wire)
    data = little.data.cast("B") if little.size else memoryview(b"")
    return Array(wire.str, array.shape, data)  # type: ignore[arg-type]


def unpack(
    what: str,
    array: Array,
    dtype: str,
    dims: Dims,
    least: float = -math.inf,
    most: float | str = math.inf,
    extents: dict[str, int] | None = None,
) -> NDArray[Any]:
    """A writable array of native byte order, with values between `least` and `most`.

    `extents` maps letters to numbers; letters that it lacks are added. A letter as `most` means the last
    index below that extent. Raises ProtocolError if dtype or shape are not as expected, the bytes do not
    match the shape, or a value is outside.
    """
    extents = {} if extents is None else extents
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
        raise ProtocolError(f"{what} {array.shape} has {array.data.nbytes} bytes, expected {expected}")
    values = np.ndarray(array.shape, dtype, array.data).astype(NATIVE[dtype])
    check_range(what, values, least, extents[most] - 1 if isinstance(most, str) else most)
    return values
