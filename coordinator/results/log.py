"""The log of results, to which each frame is appended.

A record is its length and checksum (two little-endian uint32), followed by msgpack. If the process dies, only
the last record can be incomplete; this is detected, and the record is ignored. The record of a frame contains
its results and the state after it.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, BinaryIO, get_origin

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.coordinator.bodies.angles import angles_of
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.angles import with_angles
from gepf.coordinator.results.configuration import RunConfiguration
from gepf.coordinator.results.track import Track
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.scene.scene import Scene, SceneChanges
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.state import Checkpoint, Start, TrackerState

HEAD = struct.Struct("<II")
FORM = 16


class Opening(msgspec.Struct, frozen=True, tag="opening"):
    """The start or continuation of a run, with its configuration as JSON values."""

    configuration: dict[str, Any]
    form: int = FORM


class Entry(msgspec.Struct, frozen=True, tag="frame"):
    """One frame of all people, and the run until then. A start is None if it did not change."""

    starts: list[Start | None]
    checkpoints: list[Checkpoint]
    estimates: list[Estimate]
    statistics: PoolStatistics
    seconds: float


Record = Opening | Entry


def append_records(descriptor: int, records: Sequence[Record]) -> None:
    """Append records to the file: readers see them, and they survive the end of this process."""
    payloads = [msgspec.msgpack.encode(record, enc_hook=_pack_array) for record in records]
    rest = memoryview(b"".join(HEAD.pack(len(each), zlib.crc32(each)) + each for each in payloads))
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def read_records(file: BinaryIO) -> Iterator[tuple[Record, int]]:
    """The complete records of a log, up to an incomplete one, and the position after each.

    Raises InputError if it has another format.
    """
    decoder = msgspec.msgpack.Decoder(Record, dec_hook=_unpack_array)
    size, end = os.fstat(file.fileno()).st_size, 0
    while end + HEAD.size <= size:
        length, checksum = HEAD.unpack(file.read(HEAD.size))
        end += HEAD.size + length
        payload = file.read(length) if end <= size else b""
        if end > size or zlib.crc32(payload) != checksum:
            return
        try:
            record = decoder.decode(payload)
            if isinstance(record, Opening) and record.form != FORM:
                raise msgspec.ValidationError(f"form {record.form}, not {FORM}")
        except msgspec.MsgspecError as error:
            raise InputError(
                f"the run was recorded by another version of gepf ({error}); track the sequence again"
            ) from error
        yield record, end


def _pack_array(value: object) -> tuple[str, tuple[int, ...], bytes]:
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot record a {type(value).__name__}")
    return value.dtype.str, value.shape, value.tobytes()


def _unpack_array(kind: type, packed: Any) -> object:
    if get_origin(kind) is not np.ndarray:
        raise NotImplementedError(f"cannot read a {kind}")
    dtype, shape, data = packed
    return np.frombuffer(data, dtype).reshape(shape).copy()


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPerson:
    """One person in all frames so far."""

    estimates: list[Estimate]
    state: TrackerState  # after the last frame

    @property
    def found(self) -> bool:
        """Whether the person was found in any frame."""
        return self.state.start.found


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """At least one frame, and the run until the last of them."""

    configuration: RunConfiguration
    people: list[RecordedPerson]
    statistics: PoolStatistics
    seconds: float
    resumes: int
    end: int  # bytes of complete records

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.people[0].estimates)


def read_log(path: Path) -> Recorded | None:
    """Read a log; None if it has no frame. Raises InputError if it has another format."""
    openings: list[Opening] = []
    last: Entry | None = None
    starts: list[Start | None] = []
    scenes: list[dict[str, Scene]] = []
    estimates: list[list[Estimate]] = []  # of each person
    end = 0
    with path.open("rb") as file:
        for record, place in read_records(file):
            end = place
            if isinstance(record, Opening):
                openings.append(record)
                continue
            starts = [new or old for new, old in zip_longest(record.starts, starts)]
            if last is None:
                scenes, estimates = [{} for _ in starts], [[] for _ in starts]
            last = record
            for p, checkpoint in enumerate(record.checkpoints):
                for camera, change in checkpoint.scenes.items():
                    scenes[p].setdefault(camera, Scene()).recall(change)
                estimates[p].append(record.estimates[p])
    if last is None:
        return None
    people = []
    for p, start in enumerate(starts):
        assert start is not None  # it is recorded with the first frame
        whole = {camera: scene.all() for camera, scene in scenes[p].items()}
        state = TrackerState(start, replace(last.checkpoints[p], scenes=whole))
        people.append(RecordedPerson(estimates[p], state))
    return Recorded(openings[-1].configuration, people, last.statistics, last.seconds, len(openings) - 1, end)


def floor_up(scenes: SceneChanges) -> Array | None:
    """Up direction (3,) from the floor of the first camera that sees one; None without a floor."""
    for scene in scenes.values():
        if scene.has_floor:
            return np.asarray(scene.T_rig_camera[:3, :3] @ Planes(scene.planes, has_floor=True).up)
    return None


def assemble(
    model: BodyModel,
    estimates: Sequence[Estimate],
    *,
    held: Mapping[str, float] | None = None,
    up: Array | None = None,
) -> Track:
    """The track of a run's estimates, in their order.

    `held` are the values of held degrees of freedom by name; zero if missing. `up` (3,) is the direction away
    from the ground, camera frame; None if unknown.
    """
    dofs, joints = len(model.dof_names), len(model.joint_names)
    most = max((len(e.hypothesis_weight) for e in estimates), default=0)
    weight = np.full((len(estimates), most), np.nan)
    pose = np.full((len(estimates), most, dofs), np.nan)
    for f, estimate in enumerate(estimates):
        count = len(estimate.hypothesis_weight)
        weight[f, :count], pose[f, :count] = estimate.hypothesis_weight, estimate.hypothesis_pose
    track = Track(
        frame=np.array([e.frame for e in estimates], dtype=np.int64),
        time_s=np.array([e.time_s for e in estimates], dtype=np.float64),
        dof_names=model.dof_names,
        pose=np.array([e.pose for e in estimates]).reshape(-1, dofs),
        joint_names=model.joint_names,
        joint_positions=np.array([e.joint_positions for e in estimates]).reshape(-1, joints, 3),
        joint_deviation=np.array([e.certainty.deviation for e in estimates]).reshape(-1, joints),
        joint_off_probability=np.array([e.certainty.off_probability for e in estimates]).reshape(-1, joints),
        joint_seen=np.array([e.certainty.seen for e in estimates]).reshape(-1, joints),
        hypothesis_pose=pose,
        hypothesis_weight=weight,
        status=np.array([e.status for e in estimates], dtype="<U9"),
        angle_names=(),
        angle=np.empty((len(estimates), 0)),
        angle_deviation=np.empty((len(estimates), 0)),
        up=up,
        **seen_by_cameras(estimates, joints),
    )
    return with_angles(track, angles_of(model, held, up))


def seen_by_cameras(estimates: Sequence[Estimate], joints: int) -> dict[str, Any]:
    """What each camera of a rig saw, as fields of a track; none for a single camera, which has no name."""
    cameras = tuple(sorted({n for each in estimates for n in (*each.seen_by, *each.faults) if n}))
    if not cameras:
        return {}
    unseen = np.zeros(joints)
    shares = [[each.seen_by.get(name, unseen) for name in cameras] for each in estimates]
    faults = [[each.faults.get(name, ("", 0.0))[0] for name in cameras] for each in estimates]
    return {
        "camera_names": cameras,
        "joint_seen_by": np.array(shares),
        "camera_fault": np.array(faults, dtype=np.str_),
    }
