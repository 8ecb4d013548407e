"""Bags of ROS 1 and ROS 2 with messages of any topic, as recorders write them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from gepf.common.camera import Intrinsics
from tests.support.ros import camera_of, header_of, image_of

SECOND_NS = 1_000_000_000
EPOCH_NS = 1_700_000_000 * SECOND_NS
SMALL = Intrinsics(16, 12, 50.0, 51.0, 7.5, 5.5)
TOPIC, INFO = "/camera/depth/image_raw", "/camera/depth/camera_info"


class Message(NamedTuple):
    """A message of a topic, and when it is recorded, nanoseconds."""

    topic: str
    time_ns: int
    content: Any


def types_of(path: Path) -> Any:
    """The types of a bag, of ROS 1 or ROS 2."""
    return get_typestore(Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_HUMBLE)


def numbered(frames: int) -> NDArray[np.uint16]:
    """Frames (F, H, W) in millimetres; the first pixel tells which it is."""
    values = np.full((frames, SMALL.height, SMALL.width), 2000, np.uint16)
    values[:, 0, 0] = 1000 + np.arange(frames)
    return values


def images(
    path: Path,
    records_ns: Sequence[int],
    stamps_ns: Sequence[int] | None = None,
    topic: str = TOPIC,
    frame_id: str = "depth",
) -> list[Message]:
    """Numbered images; without stamps these are zero."""
    make = types_of(path).types
    stamps = stamps_ns or [0] * len(records_ns)
    return [
        Message(topic, record, image_of(make, header_of(make, frame_id, *divmod(stamp, SECOND_NS)), depth))
        for depth, record, stamp in zip(numbered(len(records_ns)), records_ns, stamps, strict=True)
    ]


def compressed(path: Path, form: str, pictures: Iterable[bytes], topic: str, step_ns: int) -> list[Message]:
    """Compressed images."""
    make = types_of(path).types
    header, kind = header_of(make, "depth"), make["sensor_msgs/msg/CompressedImage"]
    return [
        Message(topic, EPOCH_NS + n * step_ns, kind(header, form, np.frombuffer(data, np.uint8)))
        for n, data in enumerate(pictures)
    ]


def encoded(values: NDArray[Any], form: str) -> bytes:
    """A picture file."""
    file = BytesIO()
    Image.fromarray(values).save(file, form)
    return file.getvalue()


def camera(
    path: Path, topic: str = INFO, frame_id: str = "depth", distortion: Sequence[float] = (0.0,) * 5
) -> Message:
    """The camera of the images."""
    make = types_of(path).types
    return Message(topic, EPOCH_NS, camera_of(make, header_of(make, frame_id), SMALL, distortion))


def write(path: Path, messages: Iterable[Message], plugin: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """A bag of ROS 1 if it is a `.bag`, else a folder of ROS 2."""
    types = types_of(path)
    is_1 = path.suffix == ".bag"
    with Writer1(path) if is_1 else Writer2(path, version=9, storage_plugin=plugin) as bag:
        connections: dict[str, Any] = {}
        for topic, time_ns, content in messages:
            kind = content.__msgtype__
            if topic not in connections:
                connections[topic] = bag.add_connection(topic, kind, typestore=types)
            serialize = types.serialize_ros1 if is_1 else types.serialize_cdr
            bag.write(connections[topic], time_ns, serialize(content, kind))
    return path
