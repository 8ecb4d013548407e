"""Depth of ROS image messages, raw or compressed.

Messages of the transport compressed hold PNG or TIFF. Those of compressedDepth hold PNG or RVL after a header
of 12 bytes, and depth of 32FC1 as inverse depth: it is a / (value - b) metres, with a and b of the header.
"""

from __future__ import annotations

from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gepf.common.bounds import MAX_PIXELS

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
FLOATS = "32FC1"  # metres
ENCODINGS = ("mono16", "16UC1", FLOATS)
LOSSLESS = ("PNG", "TIFF")
JPEG_START = b"\xff\xd8"
TRANSPORT, PICTURES = "/compressedDepth", "/compressed"  # ends of topics of compressed images


def encoding_of(message: Any) -> str:
    """The encoding of an image message of either type; of a compressed one without it, that of its pixels."""
    if not hasattr(message, "format"):
        return str(message.encoding)
    encoding, separator, _ = message.format.partition(";")
    if separator or is_jpeg(message):
        return str(encoding)
    try:
        with Image.open(BytesIO(content_of(message)), formats=LOSSLESS) as image:
            return FLOATS if image.mode == "F" else "16UC1" if image.mode.startswith("I") else str(image.mode)
    except (OSError, SyntaxError, ValueError):
        return str(encoding)


def is_jpeg(message: Any) -> bool:
    """Whether a message holds a JPEG, which has 8 bits and has lost depth."""
    return hasattr(message, "format") and bytes(content_of(message)[:2]) == JPEG_START


def content_of(message: Any) -> bytes:
    """The bytes of a message."""
    return np.asarray(message.data, dtype=np.uint8).tobytes()


def pixels(message: Any) -> NDArray[np.generic]:
    """Depth (H, W) of an image message, in integer units or metres; any exception if it is damaged."""
    encoding = encoding_of(message)
    if is_jpeg(message):
        raise ValueError(f"it is depth as JPEG ({message.format}), which destroys it; use ...{TRANSPORT}")
    if encoding not in ENCODINGS:
        raise ValueError(f"its encoding is {encoding}, not {', '.join(ENCODINGS)}")
    if hasattr(message, "format"):
        return decompressed(message, is_inverse=encoding == FLOATS)
    order, height, step = ">" if message.is_bigendian else "<", message.height, message.step
    kind = np.dtype(order + ("f4" if encoding == FLOATS else "u2"))
    rows = np.asarray(message.data, dtype=np.uint8)[: height * step].reshape(height, step)
    values = np.ascontiguousarray(rows[:, : kind.itemsize * message.width]).view(kind)
    return values.reshape(height, message.width)


def decompressed(message: Any, *, is_inverse: bool) -> NDArray[np.generic]:
    """Depth (H, W) of a compressed image, in integer units, or metres of inverse depth."""
    content = content_of(message)
    if TRANSPORT[1:] not in message.format:
        return unpack_picture(content)
    header, packed = content[:12], content[12:]  # an integer and two floats
    values = unpack_rvl(packed) if message.format.endswith(" rvl") else unpack_picture(packed)
    if not is_inverse:
        return values
    a, b = np.frombuffer(header, "<f4")[1:]
    inverse = np.where(values > 0, values - b, np.inf)
    return np.asarray(a / inverse, dtype=np.float32)


def unpack_picture(packed: bytes) -> NDArray[Any]:
    """The image (H, W) of a PNG or TIFF, of 16 bits or floats."""
    with Image.open(BytesIO(packed), formats=LOSSLESS) as image:
        check_pixels(*image.size)
        if image.mode != "F" and not image.mode.startswith("I"):
            raise ValueError(f"its {image.format} has pixels of type {image.mode}, not of 16 bits or floats")
        return np.asarray(image).astype(np.float32 if image.mode == "F" else np.uint16)


def unpack_rvl(packed: bytes) -> NDArray[np.uint16]:
    """The image (H, W) of RVL after its width and height."""
    from gepf.coordinator.sources.rvl import decode_rvl  # it loads the compiler

    words = np.frombuffer(packed, "<u4", len(packed) // 4)
    if len(words) < 2:
        raise ValueError("its RVL has no size")
    width, height = words[:2].tolist()
    check_pixels(width, height)
    flat = np.zeros(width * height, dtype=np.uint16)
    if not decode_rvl(words[2:].astype(np.int64), flat):
        raise ValueError("its RVL data does not have as many pixels as its size says")
    return flat.reshape(height, width)


def check_pixels(width: int, height: int) -> None:
    """ValueError for an image without pixels, or with too many."""
    if not 0 < width * height <= MAX_PIXELS:
        raise ValueError(f"its size is {width} x {height}; it must have 1 to {MAX_PIXELS} pixels")
