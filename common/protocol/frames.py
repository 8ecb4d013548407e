"""Messages with frames: for the refinement of particles, and from cameras."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

import msgspec
import numpy as np

from common.bounds import LARGEST, MAX_PIXELS, SMALLEST
from common.camera import Intrinsics
from common.errors import ProtocolError
from common.frame import SUBJECT, UNMEASURED, DepthFrame, SubjectFrame
from common.protocol.wire import (
    LIVE,
    Array,
    Message,
    Natural,
    check,
    decode,
    encode,
    pack,
    unpack,
)

Pixel = Annotated[int, msgspec.Meta(gt=-(2**31), lt=2**31)]


class FrameMessage(Message, frozen=True, tag="frame"):
    """A SubjectFrame."""

    number: Natural
    time_s: float
    depth_scale: float
    intrinsics: Intrinsics
    depth: Array
    picked: Array
    view: tuple[Pixel, Pixel, Pixel, Pixel]
    kinds: Array | None


class Numbered(msgspec.Struct, frozen=True):
    """A message with the number of a frame."""

    number: Natural


NUMBER = msgspec.msgpack.Decoder(Numbered)


class LiveFrameMessage(Message, frozen=True, kw_only=True, tag="live-frame"):
    """A whole depth image of a camera."""

    VERSION: ClassVar[int] = LIVE
    version: int = LIVE
    number: Natural
    time_s: float
    depth_scale: float
    intrinsics: Intrinsics
    depth: Array


class LiveEndMessage(Message, frozen=True, kw_only=True, tag="live-end"):
    """The end of a stream of depth images."""

    VERSION: ClassVar[int] = LIVE
    version: int = LIVE


def encode_frame(subject: SubjectFrame) -> bytes:
    """A frame for the workers."""
    frame = subject.frame
    message = FrameMessage(
        number=frame.number,
        time_s=frame.time_s,
        depth_scale=frame.depth_scale,
        intrinsics=frame.intrinsics,
        depth=pack(frame.depth),
        picked=pack(subject.picked),
        view=subject.view,
        kinds=None if subject.kinds is None else pack(subject.kinds),
    )
    return encode(message)


def decode_frame(payload: bytes) -> SubjectFrame:
    """A frame, or ProtocolError."""
    message = decode(payload, FrameMessage)
    frame = depth_frame(message)
    picked = unpack("picked", message.picked, "<u4", ("P",), {}, 0, frame.depth.size - 1)
    if np.any(picked[1:] <= picked[:-1]):
        raise ProtocolError("picked must be in ascending order")
    if not np.all(frame.depth.ravel()[picked]):
        raise ProtocolError("picked points at pixels without depth")
    left, top, right, bottom = message.view
    if left > right or top > bottom:
        raise ProtocolError(f"view {message.view} ends before it begins")
    kinds = None
    if message.kinds is not None:
        kinds = unpack("kinds", message.kinds, "|u1", frame.depth.shape, {}, 0, UNMEASURED)
        if not np.array_equal(kinds == SUBJECT, frame.depth > 0):
            raise ProtocolError("kinds and depth disagree about the subject's pixels")
    return SubjectFrame(frame, picked, message.view, kinds)


def number_of(payload: bytes) -> int:
    """The number of a frame, without decoding the rest; ProtocolError if it has none."""
    try:
        return NUMBER.decode(payload).number
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise ProtocolError(f"not a frame: {error}") from error


def encode_live(frame: DepthFrame) -> bytes:
    """A whole depth image for live input."""
    message = LiveFrameMessage(
        number=frame.number,
        time_s=frame.time_s,
        depth_scale=frame.depth_scale,
        intrinsics=frame.intrinsics,
        depth=pack(frame.depth),
    )
    return encode(message)


def encode_live_end() -> bytes:
    """The end of a stream of depth images."""
    return encode(LiveEndMessage())


def decode_live(payload: bytes) -> DepthFrame | None:
    """A whole depth image, None at the end of the stream, or ProtocolError."""
    message = decode(payload, LiveFrameMessage, LiveEndMessage)
    return depth_frame(message) if isinstance(message, LiveFrameMessage) else None


def depth_frame(message: FrameMessage | LiveFrameMessage) -> DepthFrame:
    """The depth image in a message, or ProtocolError."""
    camera = message.intrinsics
    if camera.width < 1 or camera.height < 1 or camera.width * camera.height > MAX_PIXELS:
        raise ProtocolError(
            f"a frame has 1 to {MAX_PIXELS} pixels, this one {camera.width} by {camera.height}"
        )
    check("the depth scale", message.depth_scale, SMALLEST, LARGEST)
    check("the focal lengths", np.array([camera.fx, camera.fy]), SMALLEST, LARGEST)
    check("the camera's centre", np.array([camera.cx, camera.cy]), -LARGEST, LARGEST)
    if not math.isfinite(message.time_s):
        raise ProtocolError("the frame's time must be finite")
    depth = unpack("depth", message.depth, "<u2", (camera.height, camera.width), {})
    return DepthFrame(message.number, message.time_s, depth, message.depth_scale, camera)
