"""Results as they come, in a file that is only ever appended to.

A record is its length and checksum (two little-endian uint32) and then msgpack. Whatever moment the
process dies at, the records before the last are whole, and a torn last one is recognised and passed over.
A frame's record holds what is said about it and all that the next one goes on from.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO, NamedTuple, get_origin

import msgspec
import numpy as np

from common.errors import InputError
from coordinator.pool.statistics import PoolStatistics
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.starting.start import Start
from coordinator.tracking.state import Checkpoint

HEAD = struct.Struct("<II")
FORM = 9


class Opening(msgspec.Struct, frozen=True, tag="opening"):
    """What the run was asked for, as JSON would hold it."""

    configuration: dict[str, Any]
    form: int = FORM


class Began(msgspec.Struct, frozen=True, tag="began"):
    """The body, and where tracking began, of all frames from here on."""

    start: Start


class Resumed(msgspec.Struct, frozen=True, tag="resumed"):
    """The run had ended early and goes on here."""


class Entry(msgspec.Struct, frozen=True, tag="frame"):
    """One frame, and the run until then."""

    estimate: Estimate
    checkpoint: Checkpoint
    statistics: PoolStatistics
    seconds: float


Record = Opening | Began | Resumed | Entry


class Placed(NamedTuple):
    """A record and the place in the file where it ends."""

    record: Record
    end: int


def append_records(descriptor: int, records: Sequence[Record]) -> None:
    """Write records at the file's end: there for every reader, and safe from the end of this process."""
    rest = memoryview(b"".join(map(frame_record, records)))
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def frame_record(record: Record) -> bytes:
    """A record's bytes after their length and checksum."""
    payload = msgspec.msgpack.encode(record, enc_hook=_pack_array)
    return HEAD.pack(len(payload), zlib.crc32(payload)) + payload


def read_records(file: BinaryIO) -> Iterator[Placed]:
    """The whole records of a log, up to a torn one. Raises InputError if it is of another form."""
    decoder = msgspec.msgpack.Decoder(Record, dec_hook=_unpack_array)
    size, end = os.fstat(file.fileno()).st_size, 0
    while end + HEAD.size <= size:
        length, checksum = HEAD.unpack(file.read(HEAD.size))
        end += HEAD.size + length
        payload = file.read(length) if end <= size else b""
        if end > size or zlib.crc32(payload) != checksum:
            return
        record = decode(decoder, payload)
        yield Placed(record, end)


def decode(decoder: msgspec.msgpack.Decoder[Record], payload: bytes) -> Record:
    """A record whose checksum was right."""
    try:
        record = decoder.decode(payload)
    except msgspec.MsgspecError as error:
        raise InputError(f"the run was recorded by another version of gepf ({error}); {AGAIN}") from error
    if isinstance(record, Opening) and record.form != FORM:
        raise InputError(f"the run was recorded in form {record.form}, not {FORM}; {AGAIN}")
    return record


AGAIN = "track the sequence again into another folder"


def _pack_array(value: object) -> tuple[str, tuple[int, ...], bytes]:
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot record a {type(value).__name__}")
    return value.dtype.str, value.shape, value.tobytes()


def _unpack_array(kind: type, packed: Any) -> object:
    if get_origin(kind) is not np.ndarray:
        raise NotImplementedError(f"cannot read a {kind}")
    dtype, shape, data = packed
    return np.frombuffer(data, dtype).reshape(shape).copy()
