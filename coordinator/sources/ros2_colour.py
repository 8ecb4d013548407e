"""Colour that is published beside the depth of a ROS 2 topic, by the same camera."""

from __future__ import annotations

import struct
from collections import deque
from functools import partial
from itertools import takewhile
from operator import eq
from typing import Any

from gepf.common.errors import ProtocolError
from gepf.coordinator.sources.camera import DEFAULT_FPS
from gepf.coordinator.sources.clock import SECOND_NS
from gepf.coordinator.sources.lens import Lens
from gepf.coordinator.sources.ros2 import Node, nanoseconds
from gepf.coordinator.sources.ros_colour import (
    Colours,
    colours_or_none,
    is_colour,
    is_registered,
    undistorted,
)
from gepf.coordinator.sources.ros_images import COMPRESSED, IMAGE, PICTURES

NAMES = ("color", "colour", "rgb")  # the name of a colour topic contains one of these
FARTHEST_NS = round(SECOND_NS / DEFAULT_FPS)  # largest difference in time from depth


class ColourTopic:
    """The last images of topics that are named like colour, in the namespace of a depth topic.

    No depth image waits for colour: it gets the nearest image that has come.
    """

    def __init__(self, node: Node, depth_topic: str) -> None:
        self._node, self._depth_topic = node, depth_topic
        self._is_subscribed = False
        self._last = deque[tuple[int, str, bytes]](maxlen=8)  # the last: stamp, type, message
        self._other: str | None = None  # frame of another camera, until it is reported
        self._is_reported = False

    def near(self, depth: Any, lens: Lens) -> Colours | None:
        """The colours (h, w, 3) of a depth image, by its message and lens; None if none has come."""
        self._look()
        stamp = nanoseconds(depth.header.stamp)
        for time, kind, payload in sorted([*self._last], key=lambda each: abs(each[0] - stamp)):
            if abs(time - stamp) > FARTHEST_NS:
                break
            try:
                message = self._node.read(payload, kind)
            except ProtocolError:
                continue
            if is_registered(message, depth) and is_colour(message):
                found = colours_or_none(message)
                return None if found is None else undistorted(found, lens)
            self._other = message.header.frame_id
        return None

    def take_doubt(self) -> str:
        """A line about colour of another camera, once; else empty."""
        if self._other is None or self._is_reported:
            return ""
        self._is_reported = True
        where = f"in the frame '{self._other}', not in that of {self._depth_topic}"
        return f"colour is not used, because it is {where}; publish depth that is aligned to colour"

    def _look(self) -> None:
        """Subscribe to the colour topic whose name is most like the depth topic's; raw before compressed."""
        if self._is_subscribed:
            return
        images = {topic: kind for kind in (COMPRESSED, IMAGE) for topic in self._node.topics(kind)}
        named = [
            topic
            for topic in images
            if any(name in topic.lower() for name in NAMES)
            and "depth" not in topic.lower()
            and topic.endswith(PICTURES) == (images[topic] == COMPRESSED)
        ]
        if named:
            chosen = max(named, key=lambda topic: (self._shared(topic), images[topic] == IMAGE))
            self._is_subscribed = True
            self._node.subscribe(chosen, images[chosen], partial(self._receive, images[chosen]))

    def _shared(self, topic: str) -> int:
        """The number of leading levels that a topic has in common with that of depth."""
        return len([*takewhile(bool, map(eq, topic.split("/"), self._depth_topic.split("/")))])

    def _receive(self, kind: str, payload: bytes) -> None:
        if len(payload) >= 12:
            seconds, rest = struct.unpack_from("<II" if payload[1] & 1 else ">II", payload, 4)
            self._last.append((seconds * SECOND_NS + rest, kind, payload))
