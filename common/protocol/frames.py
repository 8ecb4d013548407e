"""Frames on the wire: what workers refine particles on, and what cameras publish."""

from __future__ import annotations

from typing import Annotated, ClassVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.bounds import LARGEST_PIXEL, MAX_PIXELS
from common.camera import Intrinsics
from common.errors import ProtocolError
from common.frame import SUBJECT, UNMEASURED, DepthFrame, SubjectFrame
from common.protocol.wire import (
    LIVE,
    Array,
    Message,
    Natural,
    check_finite,
    check_indices,
    check_range,
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
    kinds: Array | None = None
    emptiness: float = 0.0


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
    """No more depth images will come."""

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
        emptiness=subject.emptiness,
    )
    return encode(message)


def decode_frame(payload: bytes) -> SubjectFrame:
    """A frame, or ProtocolError."""
    message = decode(payload, FrameMessage)
    frame = depth_frame(message)
    picked = unpack("picked", message.picked, "<u4", ("P",), {})
    check_picked(picked, frame.depth)
    left, top, right, bottom = message.view
    if left > right or top > bottom:
        raise ProtocolError(f"view {message.view} ends before it begins")
    if not 0.0 <= message.emptiness <= 1.0:
        raise ProtocolError(f"an emptiness of {message.emptiness} is not between 0 and 1")
    kinds = None
    if message.kinds is not None:
        kinds = unpack("kinds", message.kinds, "|u1", frame.depth.shape, {})
        check_kinds(kinds, frame.depth)
    return SubjectFrame(frame, picked, message.view, kinds, message.emptiness)


def encode_live(frame: DepthFrame) -> bytes:
    """A whole depth image for any program that tracks."""
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
    check_camera(camera, message.depth_scale)
    check_finite("the frame's time", message.time_s)
    depth = unpack("depth", message.depth, "<u2", (camera.height, camera.width), {})
    return DepthFrame(message.number, message.time_s, depth, message.depth_scale, camera)


def check_camera(camera: Intrinsics, depth_scale: float) -> None:
    """ProtocolError unless the numbers make a camera."""
    if not (camera.width > 0 and camera.height > 0 and camera.width * camera.height <= MAX_PIXELS):
        raise ProtocolError(
            f"a frame has 1 to {MAX_PIXELS} pixels, this one {camera.width} by {camera.height}"
        )
    for what, value in (("a focal length", camera.fx), ("a focal length", camera.fy)):
        check_range(what, value, 1e-3, LARGEST_PIXEL)
    check_range("the depth scale", depth_scale, 1e-3, LARGEST_PIXEL)
    for value in (camera.cx, camera.cy):
        check_range("the camera's centre", value, -LARGEST_PIXEL, LARGEST_PIXEL)


def check_kinds(kinds: NDArray[np.uint8], depth: NDArray[np.uint16]) -> None:
    """ProtocolError unless these are kinds of pixels, the subject's those with depth."""
    if kinds.size and kinds.max() > UNMEASURED:
        raise ProtocolError(f"kinds go up to {kinds.max()}, not {UNMEASURED}")
    if not np.array_equal(kinds == SUBJECT, depth > 0):
        raise ProtocolError("kinds and depth differ in what is the subject's")


def check_picked(picked: NDArray[np.uint32], depth: NDArray[np.uint16]) -> None:
    """ProtocolError unless these are pixels with depth, in ascending order."""
    if np.any(picked[1:] <= picked[:-1]):
        raise ProtocolError("picked must be in ascending order")
    check_indices("picked", picked[-1:], 0, depth.size)  # and so all of them
    if not np.all(depth.ravel()[picked]):
        raise ProtocolError("picked points at pixels without depth")
