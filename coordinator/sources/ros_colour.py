"""Colour of ROS that is registered to depth: images of the same camera, recorded or published beside it.

Drivers align depth to colour (`aligned_depth_to_color`, `depth_registered`, `depth_to_rgb`), or colour to
depth (`rgb_to_depth`); then the headers of both name the same frame. Other colour is not used.
"""

from __future__ import annotations

import logging
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gepf.common.errors import InputError
from gepf.coordinator.sources.bag import Bag, Clock
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.ros_images import COMPRESSED, IMAGE, PICTURES, check_pixels, content_of

logger = logging.getLogger(__name__)

CHANNELS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0), "8UC3": (2, 1, 0)}
"""Encoding -> where red, green and blue are."""
FORMATS = ("JPEG", "PNG")
ENDS = ("jpeg", "jpg", "png")  # formats of compressed messages without the encoding

Colours = NDArray[np.uint8]


def is_colour(message: Any) -> bool:
    """Whether an image message of either type holds colour."""
    if not hasattr(message, "format"):
        return message.encoding in CHANNELS
    encoding, separator, _ = message.format.partition(";")
    if separator:
        return encoding.strip() in CHANNELS
    return encoding.strip().lower() in ENDS and colours_or_none(message) is not None


def colours_of(message: Any) -> Colours:
    """The image (h, w, 3), RGB, of a message; any exception if it is damaged."""
    if hasattr(message, "format"):
        with Image.open(BytesIO(content_of(message)), formats=FORMATS) as image:
            check_pixels(*image.size)
            if len(image.getbands()) < 3:
                raise ValueError("it is grey")
            return np.array(image.convert("RGB"))
    channels = CHANNELS[message.encoding]
    count, height, step = 4 if "a" in message.encoding else 3, message.height, message.step
    rows = np.asarray(message.data, dtype=np.uint8)[: height * step].reshape(height, step)
    pixels = rows[:, : count * message.width].reshape(height, message.width, count)
    return np.ascontiguousarray(pixels[:, :, channels])


def colours_or_none(message: Any) -> Colours | None:
    """The image of a message; None if it is damaged."""
    try:
        return colours_of(message)
    except Exception:  # noqa: BLE001 libraries raise any
        return None


def is_registered(colour: Any, depth: Any) -> bool:
    """Whether images of both messages are of one camera."""
    frame, other = (message.header.frame_id.strip("/") for message in (colour, depth))
    return bool(frame == other != "")


def undistorted(colours: Colours, lens: Lens) -> Colours | None:
    """Colours of any scale as the camera of depth sees them; None if they have another shape."""
    camera, (height, width) = lens.camera, colours.shape[:2]
    if abs(width * camera.height / camera.width - height) > 1.0:
        return None
    if not any(lens.coefficients):
        return colours
    scale = width / camera.width
    scaled = msgspec.structs.replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=(camera.cx + 0.5) * scale - 0.5,
        cy=(camera.cy + 0.5) * scale - 0.5,
    )
    return (lens if scaled == camera else replace(lens, camera=scaled)).undistort(colours)


def colours_in(
    bag: Bag, depth: Any, clock: Clock, lens: Lens, within_s: float
) -> Callable[[int], Colours | None] | None:
    """Returns the colours of the n-th depth image of a bag; None if it has no registered colour.

    `depth` is the first message of depth, `clock` that of its topic.
    """
    topics = sorted([*bag.topics(IMAGE), *bag.topics(COMPRESSED)], key=lambda name: name.endswith(PICTURES))
    coloured = {topic: first for topic in topics if is_colour(first := bag.message(topic))}
    fitting = [topic for topic, first in coloured.items() if is_registered(first, depth)]
    if not fitting:
        if coloured:
            logger.warning(
                "%s: colour on %s is not used, as it is from another camera than depth; record aligned depth",
                bag.path, next(iter(coloured)),
            )  # fmt: skip
        return None
    topic = fitting[0]
    own = bag.clock(topic)
    stamped = own.kind == clock.kind == "stamps"
    times, wanted = (own.times_ns, clock.times_ns) if stamped else (own.records_ns, clock.records_ns)
    ordered = times.tolist()

    def read(number: int) -> Colours | None:
        time = int(wanted[number])
        after = bisect_left(ordered, time)
        around = range(max(0, after - 1), min(len(ordered), after + 1))
        near = min(around, key=lambda n: abs(ordered[n] - time))
        if abs(ordered[near] - time) > within_s * 1e9:
            return None
        try:
            found = colours_or_none(bag.message(topic, int(own.places[near])))
        except InputError:
            return None
        return None if found is None else undistorted(found, lens)

    return read
