"""Messages with frames: for the refinement of particles, and from cameras."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, ClassVar

import msgspec
import numpy as np

from gepf.common.body import KEYPOINTS
from gepf.common.bounds import LARGEST, MAX_CAMERAS
from gepf.common.camera import ROUNDED, Intrinsics, is_rigid
from gepf.common.checks import check_camera, check_range
from gepf.common.errors import ProtocolError
from gepf.common.frame import SUBJECT, UNMEASURED, SubjectFrame, SubjectView, View
from gepf.common.protocol.wire import LIVE, Array, Message, Natural, decode, encode, pack, unpack

Pixel = Annotated[int, msgspec.Meta(gt=-(2**31), lt=2**31)]


class ViewMessage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A SubjectView."""

    depth_scale: float
    intrinsics: Intrinsics
    depth: Array
    picked: Array
    view: tuple[Pixel, Pixel, Pixel, Pixel]
    kinds: Array | None
    T_rig_camera: Array
    delay_s: float
    keypoints: Array | None


class FrameMessage(Message, frozen=True, tag="frame"):
    """A SubjectFrame."""

    number: Natural
    time_s: float
    views: Annotated[tuple[ViewMessage, ...], msgspec.Meta(min_length=1, max_length=MAX_CAMERAS)]


class Numbered(msgspec.Struct, frozen=True):
    """A message with the number of a frame."""

    number: Natural


NUMBER = msgspec.msgpack.Decoder(Numbered)


class LiveMessage(Message, frozen=True, kw_only=True):
    """A message of a camera."""

    VERSION: ClassVar[int] = LIVE
    version: int = LIVE


class LiveFrameMessage(LiveMessage, frozen=True, kw_only=True, tag="live-frame"):
    """A whole depth image of a camera."""

    number: Natural
    time_s: float
    depth_scale: float
    intrinsics: Intrinsics
    depth: Array
    gravity: tuple[float, float, float] | None = None


class LiveColourMessage(LiveMessage, frozen=True, kw_only=True, tag="live-color"):
    """The colour image of a frame, registered to its depth, as a JPEG file."""

    number: Natural
    jpeg: memoryview


class LiveEndMessage(LiveMessage, frozen=True, kw_only=True, tag="live-end"):
    """The end of a stream of depth images."""


def encode_frame(subject: SubjectFrame) -> bytes:
    """A frame for the workers."""
    views = tuple(map(view_message, subject.views))
    return encode(FrameMessage(number=subject.number, time_s=subject.time_s, views=views))


def view_message(view: SubjectView) -> ViewMessage:
    """One view of a frame."""
    image = view.image
    return ViewMessage(
        depth_scale=image.depth_scale,
        intrinsics=image.intrinsics,
        depth=pack(image.depth),
        picked=pack(view.picked),
        view=view.extent,
        kinds=None if view.labels is None else pack(view.labels),
        T_rig_camera=pack(image.T_rig_camera),
        delay_s=view.delay_s,
        keypoints=None if view.keypoints is None else pack(view.keypoints),
    )


def decode_frame(payload: bytes) -> SubjectFrame:
    """A frame, or ProtocolError."""
    message = decode(payload, FrameMessage)
    views = tuple(decode_view(message, view) for view in message.views)
    return SubjectFrame(message.number, message.time_s, views)


def decode_view(frame: FrameMessage, message: ViewMessage) -> SubjectView:
    """One view of a frame, or ProtocolError."""
    check_range("the delay", message.delay_s, -LARGEST, LARGEST)
    image = depth_image(frame.number, frame.time_s + message.delay_s, message)
    placed = unpack("T_rig_camera", message.T_rig_camera, "<f8", (4, 4), -LARGEST, LARGEST)
    if not is_rigid(placed):
        raise ProtocolError("T_rig_camera is not a rotation and a translation")
    picked = unpack("picked", message.picked, "<u4", ("P",), 0, image.depth.size - 1)
    if np.any(picked[1:] <= picked[:-1]):
        raise ProtocolError("picked must be in ascending order")
    if not np.all(image.depth.ravel()[picked]):
        raise ProtocolError("picked points at pixels without depth")
    left, top, right, bottom = message.view
    if left > right or top > bottom:
        raise ProtocolError(f"view {message.view} ends before it begins")
    labels = None
    if message.kinds is not None:
        labels = unpack("kinds", message.kinds, "|u1", image.depth.shape, 0, UNMEASURED)
        if not np.array_equal(labels == SUBJECT, image.depth > 0):
            raise ProtocolError("kinds and depth disagree about the subject's pixels")
    image, keypoints = replace(image, T_rig_camera=placed), None
    if message.keypoints is not None:
        keypoints = unpack("keypoints", message.keypoints, "<f4", (len(KEYPOINTS), 3), -LARGEST, LARGEST)
        check_range("the precisions of keypoints", keypoints[:, 2], 0.0, LARGEST)
    return SubjectView(image, picked, message.view, labels, message.delay_s, keypoints)


def number_of(payload: bytes) -> int:
    """The number of a frame, without decoding the rest; ProtocolError if it has none."""
    try:
        return NUMBER.decode(payload).number
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise ProtocolError(f"not a frame: {error}") from error


def encode_live(image: View) -> bytes:
    """A whole depth image for live input."""
    message = LiveFrameMessage(
        number=image.number,
        time_s=image.time_s,
        depth_scale=image.depth_scale,
        intrinsics=image.intrinsics,
        depth=pack(image.depth),
        gravity=None if image.gravity is None else tuple(image.gravity.tolist()),
    )
    return encode(message)


def encode_colour(number: int, jpeg: bytes) -> bytes:
    """The colour image of a frame for live input."""
    return encode(LiveColourMessage(number=number, jpeg=memoryview(jpeg)))


def decode_colour(payload: bytes) -> tuple[int, bytes]:
    """The number of a frame, and its colour image as a JPEG file; or ProtocolError."""
    message = decode(payload, LiveColourMessage)
    return message.number, bytes(message.jpeg)


LIVE_END = encode(LiveEndMessage())
"""The end of a stream of depth images."""


def decode_live(payload: bytes) -> View | None:
    """A whole depth image, None at the end of the stream, or ProtocolError."""
    message = decode(payload, LiveFrameMessage, LiveEndMessage)
    if not isinstance(message, LiveFrameMessage):
        return None
    image = depth_image(message.number, message.time_s, message)
    if message.gravity is None:
        return image
    gravity = np.array(message.gravity)
    if not math.isclose(np.linalg.norm(gravity), 1.0, abs_tol=ROUNDED):
        raise ProtocolError("gravity must be a unit vector")
    return replace(image, gravity=gravity)


def depth_image(number: int, time_s: float, message: ViewMessage | LiveFrameMessage) -> View:
    """The depth image in a message, or ProtocolError."""
    camera = message.intrinsics
    check_camera(camera, message.depth_scale)
    if not math.isfinite(time_s):
        raise ProtocolError("the frame's time must be finite")
    depth = unpack("depth", message.depth, "<u2", (camera.height, camera.width))
    return View(number, time_s, depth, message.depth_scale, camera)
