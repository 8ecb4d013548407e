"""ROS 2 without ROS: topics as ROS's middleware rmw_zenoh maps them to Zenoh (docs/design.md there).

A topic is the key <domain>/<topic>/<type>/<hash of the type>, its messages are CDR. Each node, publisher and
subscription has a liveliness token, from which others learn of it. The types used here have the same hash in
all releases since Iron; Humble has none.
"""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from common.errors import ProtocolError
from common.transport.bus import Bus
from common.transport.channels import Publisher

NODE = "gepf"
TOKENS = "@ros2_lv"
QOS = "::,10:,:,:,,"  # reliable, volatile, the last ten messages
GID = struct.Struct("<qqB16s")  # of an attachment: number and time in ns of the message, its publisher
SECOND_NS = 1_000_000_000


class Node:
    """A node of ROS on a session of the bus, until that is closed.

    Frames have times in seconds since `began_ns`, so that their stamps are exact. `frame_id` is that of the
    camera; a source that reads images sets both.
    """

    def __init__(self, bus: Bus, domain: int) -> None:
        self.began_ns, self.frame_id = 0, "camera"
        self._bus, self._domain = bus, domain
        self._types: Any = get_typestore(Stores.ROS2_JAZZY)
        self._numbers = count(1)
        self._published: dict[str, str] = {}  # topics of publishers by token
        bus.announce(self._token(0, "NN"))
        bus.watch(f"{TOKENS}/{domain}/*/*/*/MP/**", self._note)

    def subscribe(self, topic: str, kind: str, receive: Callable[[bytes], None]) -> None:
        """Call `receive(payload)` for each message of a type, whatever its hash."""
        key, name = self._key(topic, kind)
        self._bus.subscribe(f"{key}/*", lambda _, payload: receive(payload))
        self._announce("MS", topic, name)

    def advertise(self, topic: str, kind: str) -> Advertised:
        """A publisher of messages of a type."""
        key, name = self._key(topic, kind)
        publisher = self._bus.publish(f"{key}/{self._types.hash_rihs01(kind)}")
        number = self._announce("MP", topic, name)
        return Advertised(publisher, lambda message: bytes(self._types.serialize_cdr(message, kind)), number)
