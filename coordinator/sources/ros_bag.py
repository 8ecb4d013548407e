"""A ROS 1 or ROS 2 bag with depth images and their camera_info, read by rosbags without ROS.

The `.bag` files of Intel RealSense cameras are such bags and specify their units of depth. Other bags hold
millimetres as 16-bit images, or metres as floats, compressed or not. Lens distortion is not corrected.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from itertools import takewhile
from operator import eq
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gepf.common.camera import Intrinsics
from gepf.common.errors import InputError
from gepf.coordinator.sources.camera import MILLIMETRES, GivenCamera, intrinsics_of
from gepf.coordinator.sources.ros_images import COMPRESSED, ENCODINGS, FLOATS, IMAGE, encoding_of, pixels
from gepf.coordinator.sources.source import Source, rate_of

Result = TypeVar("Result")

CAMERA, NUMBER = "sensor_msgs/msg/CameraInfo", "std_msgs/msg/Float32"


def read_ros_bag(path: Path, given: GivenCamera) -> Source:
    """Read the depth images of a bag, numbered from 0; times are those of the bag, from 0."""
    bag = Bag(path)
    topic = depth_topic(bag)
    stamps = bag.times(topic)

    def read(place: int) -> NDArray[np.generic]:
        image = bag.message(topic, stamps[place])
        return bag.guarded(lambda: pixels(image))

    floats = encoding_of(bag.message(topic)) == FLOATS
    camera = given.camera(read(0).shape, path) if given.intrinsics else camera_of(bag, topic)
    times = [(stamp - stamps[0]) * 1e-9 for stamp in stamps]
    scale = given.depth_scale or (1.0 if floats else units_of(bag, topic))
    return Source(path.stem, camera, range(len(times)), read, scale, rate_of(times), times)


class Bag:
    """Messages of a bag by topic and time; InputError if it is damaged."""

    def __init__(self, path: Path) -> None:
        self.path = path
        from rosbags.highlevel import AnyReader  # slow to load
        from rosbags.typesys import Stores, get_typestore

        types = get_typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_HUMBLE)
        self._reader = self.guarded(lambda: AnyReader([path], default_typestore=types))
        self.guarded(self._reader.open)
        weakref.finalize(self, self._reader.close)

    def topics(self, kind: str) -> list[str]:
        """Topics with messages of a type, by name."""
        return sorted({c.topic for c in self._reader.connections if c.msgtype == kind and c.msgcount})

    def times(self, topic: str) -> list[int]:
        """Times of a topic's messages, nanoseconds, ascending."""
        connections = self._connections(topic)
        return self.guarded(lambda: [t for _, t, _ in self._reader.messages(connections)])

    def message(self, topic: str, time: int | None = None) -> Any:
        """A topic's message at a time, or its first."""
        connections, stop = self._connections(topic), None if time is None else time + 1

        def read() -> Any:
            connection, _, data = next(self._reader.messages(connections, time, stop))
            return self._reader.deserialize(data, connection.msgtype)

        return self.guarded(read)

    def guarded(self, read: Callable[[], Result]) -> Result:
        """The result of `read`; the library can raise any exception for a damaged bag."""
        try:
            return read()
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"{self.path} is damaged or not a ROS bag ({reason}); copy it again") from error

    def _connections(self, topic: str) -> list[Any]:
        return [c for c in self._reader.connections if c.topic == topic]


def depth_topic(bag: Bag) -> str:
    """The topic with depth images, preferably with depth in its name."""
    images = [*bag.topics(IMAGE), *bag.topics(COMPRESSED)]
    for topic in sorted(images, key=lambda topic: "depth" not in topic.lower()):
        if encoding_of(bag.message(topic)) in ENCODINGS:
            return topic
    raise InputError(f"{bag.path} holds no depth images (16UC1 or 32FC1); record the camera's depth topic")


def camera_of(bag: Bag, topic: str) -> Intrinsics:
    """The camera of a topic's images: the camera_info with the most similar name."""
    infos = bag.topics(CAMERA)
    if not infos:
        raise InputError(f"{bag.path} holds no camera_info; record it, or add --intrinsics fx,fy,cx,cy")
    info = bag.message(nearest(topic, infos))
    return camera_in(info, str(bag.path))


def camera_in(info: Any, name: str) -> Intrinsics:
    """The camera of a camera_info, of ROS 1 or ROS 2; InputError if it is not calibrated."""
    matrix = np.reshape(info.K if hasattr(info, "K") else info.k, (3, 3))
    return intrinsics_of(matrix, info.width, info.height, f"{name}: camera_info, from a calibrated camera")


def units_of(bag: Bag, topic: str) -> float:
    """Units of depth per metre."""
    stated = [t for t in bag.topics(NUMBER) if t.endswith("/Depth_Units/value")]
    if not stated:
        return MILLIMETRES
    # a float32: 0.0010000000474974513 means 0.001
    metres = float(str(np.float32(bag.message(nearest(topic, stated)).data)))
    if not 0 < metres < np.inf:
        raise InputError(f"{bag.path}: the stated unit of depth is {metres} m; record it again")
    return round(1.0 / metres, 6)


def nearest(topic: str, others: list[str]) -> str:
    """The topic whose name has the most leading levels in common with `topic`."""

    def shared(other: str) -> int:
        return len([*takewhile(bool, map(eq, topic.split("/"), other.split("/")))])

    return max(others, key=shared)


def is_bag(path: Path) -> bool:
    """Whether a path is a ROS 1 bag, or a folder that ROS 2 recorded."""
    return (path.is_file() and path.suffix.lower() == ".bag") or (path / "metadata.yaml").is_file()
