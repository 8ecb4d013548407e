"""Results as they come, in a file that is only ever appended to.

A record is its length and checksum (two little-endian uint32) and then msgpack. Whatever moment the
process dies at, the records before the last are whole, and a torn last one is recognised and passed over.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.errors import InputError
from coordinator.estimate import Estimate, Status

HEAD = struct.Struct("<II")
FORM = 1


class Floats(msgspec.Struct, frozen=True, array_like=True):
    """A float64 array, little-endian."""

    shape: tuple[int, ...]
    data: bytes

    @classmethod
    def of(cls, array: NDArray[np.float64]) -> Floats:
        """The array's values as bytes."""
        return cls(array.shape, np.ascontiguousarray(array, dtype="<f8").tobytes())

    def array(self) -> NDArray[np.float64]:
        """The array again."""
        return np.frombuffer(self.data, dtype="<f8").reshape(self.shape).astype(np.float64)


class Opening(msgspec.Struct, frozen=True, tag="opening"):
    """What all frames of a run have in common."""

    dof_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    form: int = FORM


class Entry(msgspec.Struct, frozen=True, tag="frame"):
    """One frame's estimate."""

    frame: int
    time_s: float
    status: Status
    pose: Floats
    joint_positions: Floats
    hypothesis_pose: Floats
    hypothesis_weight: Floats
    residual: float | None  # None where nothing was observed
    stage_seconds: dict[str, float]


Record = Opening | Entry


def entry_of(estimate: Estimate) -> Entry:
    """An estimate in the form that is written."""
    return Entry(
        frame=estimate.frame,
        time_s=estimate.time_s,
        status=estimate.status,
        pose=Floats.of(estimate.pose),
        joint_positions=Floats.of(estimate.joint_positions),
        hypothesis_pose=Floats.of(estimate.hypothesis_pose),
        hypothesis_weight=Floats.of(estimate.hypothesis_weight),
        residual=None if np.isnan(estimate.residual) else float(estimate.residual),
        stage_seconds=estimate.stage_seconds,
    )


def estimate_of(entry: Entry) -> Estimate:
    """The estimate again, value for value."""
    return Estimate(
        frame=entry.frame,
        time_s=entry.time_s,
        status=entry.status,
        pose=entry.pose.array(),
        joint_positions=entry.joint_positions.array(),
        hypothesis_pose=entry.hypothesis_pose.array(),
        hypothesis_weight=entry.hypothesis_weight.array(),
        residual=float("nan") if entry.residual is None else entry.residual,
        stage_seconds=entry.stage_seconds,
    )


def append_record(descriptor: int, record: Record) -> None:
    """Write one record at the file's end and return when it will survive the machine's loss of power."""
    payload = msgspec.msgpack.encode(record)
    rest = memoryview(HEAD.pack(len(payload), zlib.crc32(payload)) + payload)
    while rest:
        rest = rest[os.write(descriptor, rest) :]
    os.fdatasync(descriptor)


def read_records(content: bytes) -> Iterator[Record]:
    """The whole records of a log, up to a torn one. Raises InputError if it is of another form."""
    decoder: msgspec.msgpack.Decoder[Record] = msgspec.msgpack.Decoder(Record)
    start = 0
    while start + HEAD.size <= len(content):
        length, checksum = HEAD.unpack_from(content, start)
        payload = content[start + HEAD.size : start + HEAD.size + length]
        if len(payload) < length or zlib.crc32(payload) != checksum:
            return
        record = decoder.decode(payload)
        if isinstance(record, Opening) and record.form != FORM:
            raise InputError(f"the run was recorded in form {record.form}, not {FORM}; track it again")
        yield record
        start += HEAD.size + length
