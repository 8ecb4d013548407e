"""ROS 2 without ROS: topics as ROS's middleware rmw_zenoh maps them to Zenoh (docs/design.md there).

A topic is the key <domain>/<topic>/<type>/<hash of the type>, its messages are CDR. Each node, publisher and
subscription has a liveliness token, from which others learn of it. The types used here have the same hash in
all releases since Iron; Humble has none.
"""

from __future__ import annotations

import struct
import time
import uuid
from collections.abc import Callable
from itertools import count
from typing import Any

from gepf.common.errors import ProtocolError
from gepf.common.transport.bus import Bus
from gepf.common.transport.channels import Publisher
from gepf.coordinator.sources.clock import SECOND_NS

TOKENS = "@ros2_lv"
QOS = "::,10:,:,:,,"  # reliable, volatile, the last ten messages
ATTACHMENT = struct.Struct("<qqB16s")  # number of the message, its time in ns, identity of the publisher


class Node:
    """A node of ROS on a session of the bus, until that is closed.

    A source that reads images sets `began_ns`, the time of ROS at which times of frames are 0, so that stamps
    of results are exactly those of the images, and `frame_id`, the name of the camera's frame.
    """

    def __init__(self, bus: Bus, domain: int) -> None:
        from rosbags.typesys import Stores, get_typestore  # slow to load

        self.began_ns, self.frame_id = 0, "camera"
        self._bus, self._domain = bus, domain
        self._types: Any = get_typestore(Stores.ROS2_JAZZY)
        self._numbers = count(1)
        self._publishers: dict[str, tuple[str, str]] = {}  # topic and type by token
        bus.announce(self._token(0, "NN"))
        bus.watch(f"{TOKENS}/{domain}/*/*/*/MP/**", self._note)

    def subscribe(self, topic: str, kind: str, receive: Callable[[bytes], None]) -> None:
        """Call `receive(payload)` for each message of a type, whatever its hash."""
        self._bus.subscribe(f"{self._domain}{topic}/{dds_name(kind)}/*", lambda _, payload: receive(payload))
        self._announce("MS", topic, kind)

    def advertise(self, topic: str, kind: str) -> Advertised:
        """A publisher of messages of a type."""
        publisher = self._bus.publish(
            f"{self._domain}{topic}/{dds_name(kind)}/{self._types.hash_rihs01(kind)}"
        )
        self._announce("MP", topic, kind)
        return Advertised(publisher, lambda message: bytes(self._types.serialize_cdr(message, kind)))

    def topics(self, *kinds: str) -> list[str]:
        """The topics with publishers of these types."""
        names = [dds_name(kind) for kind in kinds]
        return sorted({topic for topic, name in [*self._publishers.values()] if name in names})

    def read(self, payload: bytes, kind: str) -> Any:
        """A message of a type; ProtocolError if it is malformed."""
        try:
            return self._types.deserialize_cdr(payload, kind)
        except Exception as error:  # any, for a damaged message
            raise ProtocolError(f"not a {kind}: {str(error) or type(error).__name__}") from error

    def define(self, kind: str, definition: str) -> None:
        """Add a type that is not one of ROS's own, by the text of its `.msg` file."""
        from rosbags.typesys import get_types_from_msg

        if kind not in self._types.types:
            self._types.register(get_types_from_msg(definition, kind))

    def type(self, kind: str) -> Any:
        """The class of a type's messages, with its constants."""
        return self._types.types[kind]

    def make(self, kind: str, *fields: Any) -> Any:
        """A message of a type, with all its fields in order."""
        return self.type(kind)(*fields)

    def header(self, time_s: float) -> Any:
        """The header of a message about a frame."""
        stamp = divmod(self.began_ns + round(time_s * SECOND_NS), SECOND_NS)
        return self.make(
            "std_msgs/msg/Header", self.make("builtin_interfaces/msg/Time", *stamp), self.frame_id
        )

    def _announce(self, role: str, topic: str, kind: str) -> None:
        token = self._token(next(self._numbers), role)
        described = topic.replace("/", "%"), dds_name(kind), self._types.hash_rihs01(kind), QOS
        self._bus.announce("/".join([token, *described]))

    def _token(self, number: int, role: str) -> str:
        """A token without enclave and namespace."""
        return f"{TOKENS}/{self._domain}/{self._bus.identity}/0/{number}/{role}/%/%/gepf"

    def _note(self, token: str, alive: bool) -> None:
        described = token.split("/")[9:11]
        if not alive:
            self._publishers.pop(token, None)
        elif len(described) == 2:
            self._publishers[token] = described[0].replace("%", "/"), described[1]


class Advertised:
    """A publisher of a topic; messages are dropped if the link is overloaded."""

    def __init__(self, publisher: Publisher, encode: Callable[[Any], bytes]) -> None:
        self._publisher, self._encode = publisher, encode
        self._numbers, self._identity = count(1), uuid.uuid4().bytes

    @property
    def has_subscriber(self) -> bool:
        """Whether there is a subscriber."""
        return self._publisher.has_subscriber

    def put(self, message: Any, change: Callable[[bytes], bytes] = bytes) -> None:
        """Publish a message, of which `change` may replace the encoded bytes."""
        identity = self._identity
        attachment = ATTACHMENT.pack(next(self._numbers), time.time_ns(), len(identity), identity)
        self._publisher.put(change(self._encode(message)), attachment)


def dds_name(kind: str) -> str:
    """The name of a type in keys, such as sensor_msgs::msg::dds_::Image_ for sensor_msgs/msg/Image."""
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def nanoseconds(stamp: Any) -> int:
    """A time of ROS in nanoseconds since 1970."""
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)
