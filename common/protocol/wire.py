"""The form of every message: msgpack maps of a protocol version, limited in size."""

from __future__ import annotations

from functools import lru_cache, reduce
from operator import or_
from typing import Annotated, Any, ClassVar, TypeVar

import msgpack  # type: ignore[import-untyped]
import msgspec

from common.camera import Intrinsics
from common.errors import ProtocolError, VersionError
from common.protocol.arrays import Array
from common.protocol.keys import NAME
from common.settings import RefineSettings

PROTOCOL = 8  # between coordinator and workers
LIVE = 1  # of what cameras publish, which others write, too: docs/live.md
MAX_BYTES = 64 * 2**20  # of one message
MAX_REASON = 1_000  # characters

Natural = Annotated[int, msgspec.Meta(ge=0, lt=2**53)]
Pixel = Annotated[int, msgspec.Meta(gt=-(2**31), lt=2**31)]
Name = Annotated[str, msgspec.Meta(max_length=200)]
Names = Annotated[tuple[Name, ...], msgspec.Meta(max_length=10_000)]
FEW = msgspec.Meta(max_length=50)  # fields of a map
Hash = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]
RunName = Annotated[str, msgspec.Meta(pattern=rf"^{NAME.pattern}\Z")]


class Header(msgspec.Struct, frozen=True):
    """What every message of every version begins with."""

    version: int


class Message(msgspec.Struct, frozen=True, kw_only=True, tag_field="kind", forbid_unknown_fields=True):
    """A message of this version."""

    VERSION: ClassVar[int] = PROTOCOL
    version: int = PROTOCOL


class FrameMessage(Message, frozen=True, tag="frame"):
    """A SubjectFrame."""

    number: Natural
    time_s: float
    depth_scale: float
    intrinsics: Intrinsics
    depth: Array
    picked: Array
    view: tuple[Pixel, Pixel, Pixel, Pixel]
    kinds: Array | None = None
    emptiness: float = 0.0


class LiveFrameMessage(Message, frozen=True, kw_only=True, tag="live-frame"):
    """A whole depth image from somebody's camera."""

    VERSION: ClassVar[int] = LIVE
    version: int = LIVE
    number: Natural
    time_s: float
    depth_scale: float
    intrinsics: Intrinsics
    depth: Array


class LiveEndMessage(Message, frozen=True, kw_only=True, tag="live-end"):
    """No more depth images will come."""

    VERSION: ClassVar[int] = LIVE
    version: int = LIVE


class ModelMessage(Message, frozen=True, tag="model"):
    """A BodyModel: its texts, lists of names and arrays by field."""

    hash: Hash
    texts: Annotated[dict[str, Name], FEW]
    names: Annotated[dict[str, Names], FEW]
    arrays: Annotated[dict[str, Array], FEW]


class RequestMessage(Message, frozen=True, tag="request"):
    """A RefineRequest."""

    run: RunName
    frame: Natural
    model: Hash
    settings: RefineSettings
    poses: Array
    thick: Hash | None = None  # with sizes: the same body, thicker
    sizes: Array | None = None
    covariance: bool = False


class ReplyMessage(Message, frozen=True, tag="reply"):
    """Refined particles (N, D): all their poses, then log likelihoods, then residuals, in one row."""

    values: Array


class SureReplyMessage(Message, frozen=True, tag="sure-reply"):
    """The same, and how sure each of them is: the lower triangles of roots of covariances."""

    values: Array
    covariance_roots: Array


class RefusalMessage(Message, frozen=True, tag="refusal"):
    """Why a request was not served; retryable if only its frame or model was not found."""

    reason: Annotated[str, msgspec.Meta(max_length=MAX_REASON)]
    retryable: bool = False


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
