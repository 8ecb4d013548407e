"""Messages of ROS 1 and ROS 2 bags by topic and position, read by rosbags without ROS.

A bag whose recorder was killed has no index, or is a storage file without metadata; it is read as far as it
was written.
"""

from __future__ import annotations

import logging
import struct
import weakref
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from gepf.common.arrays import Indices
from gepf.common.errors import InputError
from gepf.coordinator.sources.clock import SECOND_NS, is_plausible, order_of

logger = logging.getLogger(__name__)

Result = TypeVar("Result")

STORAGES = (".mcap", ".db3")
UNFINISHED = ".bag.active"  # name of a ROS 1 bag while it is recorded
STAMP = struct.Struct("<II"), struct.Struct(">II")
"""Seconds and nanoseconds in a message that begins with a header, after 4 bytes of its number, or of CDR."""


def is_bag(path: Path) -> bool:
    """Whether a path is a bag of ROS 1, or a folder or a file that ROS 2 recorded."""
    if path.is_file():
        return path.suffix.lower() in (".bag", *STORAGES) or path.name.endswith(UNFINISHED)
    return (path / "metadata.yaml").is_file() or bool(storages_in(path))


def storages_in(folder: Path) -> list[Path]:
    """The files of a ROS 2 bag, in the order of their numbers."""
    files = [file for file in folder.glob("*") if file.suffix in STORAGES] if folder.is_dir() else []
    return sorted(files, key=lambda file: order_of(file.stem))


@dataclass(frozen=True, slots=True, eq=False)
class Clock:
    """The messages of a topic in the order of their times.

    places: (N,) positions in the bag. times_ns: (N,) ascending, nanoseconds. records_ns: when they were
    recorded. kind: whether times are the header's stamps, those of recording, or evenly spaced.
    """

    places: Indices
    times_ns: Indices
    records_ns: Indices
    kind: str


class Bag:
    """Messages of a bag by topic and position; InputError if it is damaged."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._records = dict[str, list[int]]()  # times of recording by topic, nanoseconds
        self._reader = self.guarded(lambda: open_bag(path))
        weakref.finalize(self, self._reader.close)

    def topics(self, kind: str) -> list[str]:
        """Topics with messages of a type, by name."""
        return sorted({c.topic for c in self._reader.connections if c.msgtype == kind and c.msgcount})

    def clock(self, topic: str) -> Clock:
        """The messages of a topic in the order of their stamps, unless these are missing.

        Stamps are missing if one is zero, or if most are repeated. Then times are those of recording; if
        these make no plausible rate, as when messages are written in bursts, they are evenly spaced.
        """
        connections = self._connections(topic)
        read = self.guarded(
            lambda: [(t, stamp_of(c, data)) for c, t, data in self._reader.messages(connections)]
        )
        records, stamps = np.array(read, dtype=np.int64).reshape(-1, 2).T
        self._records[topic] = records.tolist()
        order = np.argsort(stamps, kind="stable")
        new = order[np.diff(stamps[order], prepend=-1) > 0]
        if len(records) and stamps.min() > 0 and 2 * len(new) > len(records):
            if len(new) < len(records):
                count = len(records) - len(new)
                logger.warning("%s: %d messages that repeat a stamp are left out", self.path, count)
            return Clock(new, stamps[new], records[new], "stamps")
        places, steps = np.arange(len(records)), np.diff(records)
        if not len(steps) or ((steps > 0).all() and is_plausible(float(np.median(steps)) / SECOND_NS)):
            return Clock(places, records, records, "records")
        logger.warning("%s: %s has no stamps and is recorded in bursts; evenly spaced times are assumed",
                       self.path, topic)  # fmt: skip
        even = np.linspace(records[0], max(records[-1], records[0] + len(steps)), len(records))
        return Clock(places, np.rint(even).astype(np.int64), records, "even")

    def message(self, topic: str, place: int = 0) -> Any:
        """A topic's message by its position."""
        connections = self._connections(topic)
        records = self._records.get(topic)
        if place and records is None:
            records = self._records[topic] = self.guarded(
                lambda: [time for _, time, _ in self._reader.messages(connections)]
            )
        start = None if records is None else records[place]
        before = 0 if records is None or start is None else place - bisect_left(records, start)
        stop = None if start is None else start + 1

        def read() -> Any:
            connection, _, data = next(islice(self._reader.messages(connections, start, stop), before, None))
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


def open_bag(path: Path) -> Any:
    """An open reader of a bag, of rosbags; any exception if it is damaged."""
    from rosbags.highlevel import AnyReader  # slow to load
    from rosbags.typesys import Stores, get_typestore

    from gepf.coordinator.sources.unfinished_bags import mend

    is_1 = path.suffix.lower() == ".bag" or path.name.endswith(UNFINISHED)
    types = get_typestore(Stores.ROS1_NOETIC if is_1 else Stores.ROS2_HUMBLE)
    paths = storages_in(path) if path.is_dir() and not (path / "metadata.yaml").is_file() else [path]
    with TemporaryDirectory() as folder:
        if is_1 and path.suffix != ".bag":  # the library knows such bags by this suffix
            paths = [Path(folder, "bag.bag")]
            paths[0].symlink_to(path.resolve())
        reader = AnyReader(paths, default_typestore=types)
        if mend(reader):
            logger.warning("%s was not closed by its recorder; it is read as far as it goes", path)
        reader.open()
    return reader


def stamp_of(connection: Any, data: bytes) -> int:
    """The stamp of a message that begins with a header, nanoseconds; 0 for other messages."""
    is_1 = not hasattr(connection.ext, "serialization_format")
    if len(data) < 12:
        return 0
    seconds, nanoseconds = STAMP[not is_1 and not data[1] & 1].unpack_from(data, 4)
    return int(seconds) * SECOND_NS + int(nanoseconds)
