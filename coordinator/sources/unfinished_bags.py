"""Bags whose recorder was killed: of ROS 1 without an index, MCAP files without their end."""

from __future__ import annotations

import os
import struct
from collections import defaultdict
from io import BytesIO
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.rosbag1.reader import ChunkInfo, Header, IndexData, Reader, ReaderError, RecordType, read_uint32
from rosbags.rosbag2 import Reader as Reader2
from rosbags.rosbag2.storage_mcap import McapReader

MCAP_MAGIC = b"\x89MCAP0\r\n"  # at the beginning and at the end of a file


def mend(reader: AnyReader) -> bool:
    """Prepare a reader that is not open yet to read unfinished bags; returns whether there are any."""
    unindexed = [r for r in reader.readers if isinstance(r, Reader) and not is_indexed(Path(str(r.path)))]
    if unindexed:
        reader.readers = [UnindexedBag(each.path) for each in unindexed]
    cut = False
    for each in reader.readers:
        storage = getattr(each, "storage", None)
        if isinstance(each, Reader2) and isinstance(storage, McapReader) and is_cut(Path(str(storage.path))):
            each.storage, cut = CutMcap(storage.path), True
    return bool(unindexed) or cut


def is_indexed(path: Path) -> bool:
    """Whether a ROS 1 bag has an index, which is written when its recording ends."""
    with path.open("rb") as file:
        file.readline()
        return Header.read(file, RecordType.BAGHEADER).get_uint64("index_pos") > 0


class UnindexedBag(Reader):
    """A ROS 1 bag whose index is made by reading all chunks that were written completely."""

    def open(self) -> None:
        """Open the bag and find its messages."""
        self.bio = bio = self.path.open("rb")
        size, indexes = os.fstat(bio.fileno()).st_size, defaultdict[int, list[IndexData]](list)
        connections: dict[int, Any] = {}
        bio.readline()
        while True:
            start = bio.tell()
            try:
                header, length = Header.read(bio), read_uint32(bio)
            except ReaderError:
                break
            if bio.tell() + length > size:
                break
            end = bio.tell() + length
            if header.get_uint8("op") == RecordType.CHUNK and length:
                bio.seek(start)
                chunk = self.chunks[start] = self.read_chunk()
                bio.seek(chunk.datapos)
                self._find_messages(chunk.decompressor(bio.read(length)), start, indexes, connections)
            bio.seek(end)
        self.indexes = {key: sorted(indexes[key]) for key in connections}
        self.connections = [
            each._replace(msgcount=len(self.indexes[key])) for key, each in connections.items()
        ]

    def _find_messages(
        self, content: bytes, start: int, indexes: dict[int, list[IndexData]], connections: dict[int, Any]
    ) -> None:
        """Add the connections and messages of the chunk that starts at an offset of the file."""
        file, self.bio = self.bio, BytesIO(content)
        times, counts = list[int](), defaultdict[int, int](int)
        while (offset := self.bio.tell()) < len(content):
            header = Header.read(self.bio)
            key = header.get_uint32("conn")
            if header.get_uint8("op") == RecordType.CONNECTION:
                self.bio.seek(offset)
                connections.setdefault(key, self.read_connection())
                continue
            times.append(header.get_time("time"))
            counts[key] += 1
            indexes[key].append(IndexData(times[-1], start, offset))
            self.bio.seek(read_uint32(self.bio), os.SEEK_CUR)
        self.bio = file
        if times:
            self.chunk_infos.append(ChunkInfo(start, min(times), max(times) + 1, counts))


def is_cut(path: Path) -> bool:
    """Whether an MCAP file lacks its end, which is written when its recording ends."""
    with path.open("rb") as file:
        whole = file.read(len(MCAP_MAGIC)) == MCAP_MAGIC
        file.seek(-len(MCAP_MAGIC), os.SEEK_END)
        return whole and file.read() != MCAP_MAGIC


class CutMcap(McapReader):
    """An MCAP file whose last records are missing."""

    def _open(self) -> None:
        """Find the messages of the complete records."""
        assert self.bio is not None
        self.data_start = self.data_end = len(MCAP_MAGIC)
        size = self.bio.seek(0, os.SEEK_END)
        while self.data_end + 9 <= size:
            self.bio.seek(self.data_end + 1)
            (length,) = struct.unpack("<Q", self.bio.read(8))
            if self.data_end + 9 + length > size:
                break
            self.data_end += 9 + length
        self.meta_scan()
        assert self.statistics is not None
        counts = self.statistics.channel_message_counts
        self.connections = [each._replace(msgcount=counts.get(each.id, 0)) for each in self.connections]
        self.metadata = self.metadata._replace(
            start_time=self.statistics.start_time,
            end_time=self.statistics.end_time + 1,
            message_count=self.statistics.message_count,
        )
