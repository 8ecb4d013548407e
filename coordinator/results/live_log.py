"""The log of a live run, `live.mcap`: estimates only, readable after a kill at any byte.

MCAP is a file of records to which chunks are appended, each with its checksum. Each frame is one chunk, which
contains all it needs: what was written before is read whatever happens afterwards, and a run costs the same
memory however long it is. Topics: `run`, the configuration; `bodies`, the tracked bodies when they change;
`frames`, the estimates as JSON, in which NaN is null.
"""

from __future__ import annotations

import os
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import IndexType, Writer

from gepf.common.errors import InputError
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.log import pack_array, unpack_array
from gepf.coordinator.tracking.estimate import Certainty, Estimate
from gepf.coordinator.tracking.state import Start

FORM = 1
TORN = (McapError, struct.error, ValueError, OverflowError, MemoryError, zstandard.ZstdError)
"""Raised for an incomplete or altered chunk."""
ARRAYS = ("pose", "joint_positions", "hypothesis_pose", "hypothesis_weight")


class LiveOpening(msgspec.Struct, frozen=True):
    """The start of a live run: its configuration, and what its summary says of the pool, as JSON values."""

    configuration: dict[str, Any]
    pool: dict[str, Any]
    form: int = FORM


class LiveBodies(msgspec.Struct, frozen=True):
    """The bodies of all people from the next frame on; None for a body that did not change."""

    starts: list[Start | None]


class LivePerson(msgspec.Struct, frozen=True):
    """One person in a frame; `up` (3,), `shape` (S,) and `stature_deviation` (m) are after the frame."""

    estimate: dict[str, Any]
    shape: list[float]
    stature_deviation: float
    up: list[float] | None


class LiveFrame(msgspec.Struct, frozen=True):
    """One frame of all people, and the run until then."""

    people: list[LivePerson]
    statistics: PoolStatistics
    seconds: float


Record = LiveOpening | LiveBodies | LiveFrame

ENCODINGS: dict[type[Record], tuple[str, str]] = {
    LiveOpening: ("run", "json"),
    LiveBodies: ("bodies", "msgpack"),
    LiveFrame: ("frames", "json"),
}
"""Topic and encoding of each kind of record."""

DECODERS: dict[str, Callable[[bytes], Record]] = {
    "run": msgspec.json.Decoder(LiveOpening).decode,
    "bodies": msgspec.msgpack.Decoder(LiveBodies, dec_hook=unpack_array).decode,
    "frames": msgspec.json.Decoder(LiveFrame).decode,
}


def open_container(file: BinaryIO) -> None:
    """Write the head of a container."""
    Writer(file, index_types=IndexType.NONE).start("gepf")


def append_chunk(file: BinaryIO, number: int, records: Sequence[Record]) -> None:
    """Append records as one chunk; chunks are numbered from 0. Readers see it, and it survives this process.

    Each chunk has a new writer, because a writer keeps an index of its chunks in memory.
    """
    writer, now = Writer(file, index_types=IndexType.NONE), time.time_ns()
    channels = {kind: writer.register_channel(*named, schema_id=0) for kind, named in ENCODINGS.items()}
    for record in records:
        if isinstance(record, LiveBodies):
            payload = msgspec.msgpack.encode(record, enc_hook=pack_array)
        else:
            payload = msgspec.json.encode(record, enc_hook=as_list)
        writer.add_message(channels[type(record)], now, payload, now, sequence=number)
    writer.flush()  # type: ignore[no-untyped-call]


def read_chunks(path: Path) -> Iterator[list[Record]]:
    """The records of each complete chunk, up to a damaged one; InputError if they have another format."""
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        chunks = StreamReader(file, emit_chunks=True, record_size_limit=size).records
        for number in count():
            try:
                chunk = next(each for each in chunks if isinstance(each, Chunk))
                content = breakup_chunk(chunk, validate_crc=True)
            except (StopIteration, *TORN):
                return
            topics = {each.id: each.topic for each in content if isinstance(each, Channel)}
            messages = [each for each in content if isinstance(each, Message)]
            if {each.sequence for each in messages} != {number}:  # an earlier chunk is unreadable
                return
            try:
                yield [DECODERS[topics[each.channel_id]](each.data) for each in messages]
            except (msgspec.MsgspecError, KeyError) as error:
                raise InputError(
                    f"{path} was written by another version of gepf ({error}); finish it with that version"
                ) from error


def as_list(value: object) -> object:
    """An array as nested lists, for JSON."""
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot record a {type(value).__name__}")
    return value.tolist()


def as_estimate(values: dict[str, Any]) -> Estimate:
    """The estimate of a record."""
    arrays = {name: np.array(values[name], np.float64) for name in ARRAYS}
    arrays["hypothesis_pose"] = arrays["hypothesis_pose"].reshape(-1, len(arrays["pose"]))
    certainty = {name: np.array(each, np.float64) for name, each in values["certainty"].items()}
    changed = {
        "residual": np.nan if values["residual"] is None else values["residual"],
        "certainty": Certainty(**certainty),
        "seen_by": {name: np.array(each, np.float64) for name, each in values["seen_by"].items()},
        "keypoints": {name: np.array(each, np.float64) for name, each in values.get("keypoints", {}).items()},
        "faults": {name: (kind, since_s) for name, (kind, since_s) in values["faults"].items()},
    }
    return Estimate(**{**values, **arrays, **changed})


def is_empty(path: Path) -> bool:
    """Whether a container holds no frame."""
    return not any(isinstance(record, LiveFrame) for chunk in read_chunks(path) for record in chunk)
