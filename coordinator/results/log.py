"""The log of results, to which each frame is appended.

A record is its length and checksum (two little-endian uint32), followed by msgpack. If the process dies, only
the last record can be incomplete; this is detected, and the record is ignored. The record of a frame contains
its results and the state after it.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, BinaryIO, get_origin

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.pool.options import PoolStatistics
from gepf.coordinator.results.angles import with_angles
from gepf.coordinator.results.summary import RunTotals
from gepf.coordinator.results.tally import Outcome, Tally
from gepf.coordinator.results.track import NewArray, Track
from gepf.coordinator.scene.planes import Planes
from gepf.coordinator.scene.scene import Scene, SceneChanges
from gepf.coordinator.settings import SceneSettings
from gepf.coordinator.tracking.estimate import Estimate
from gepf.coordinator.tracking.state import Checkpoint, FrameState, PersonState, Start, TrackerState

HEAD = struct.Struct("<II")
FORM = 23


class Opening(msgspec.Struct, frozen=True, tag="opening"):
    """The start or continuation of a run, with its configuration as JSON values."""

    configuration: dict[str, Any]
    form: int = FORM


class Entry(msgspec.Struct, frozen=True, tag="frame"):
    """One frame, all people in it, and the run until then. A start is None if it did not change."""

    frame: FrameState
    starts: list[Start | None]
    checkpoints: list[Checkpoint]
    estimates: list[Estimate]
    statistics: PoolStatistics
    seconds: float


Record = Opening | Entry


def append_records(descriptor: int, records: Sequence[Record]) -> None:
    """Append records to the file: readers see them, and they survive the end of this process."""
    payloads = [msgspec.msgpack.encode(record, enc_hook=pack_array) for record in records]
    rest = memoryview(b"".join(HEAD.pack(len(each), zlib.crc32(each)) + each for each in payloads))
    while rest:
        rest = rest[os.write(descriptor, rest) :]


def read_records(file: BinaryIO) -> Iterator[tuple[Record, int]]:
    """The complete records of a log, up to an incomplete one, and the position after each.

    Raises InputError if it has another format.
    """
    decoder = msgspec.msgpack.Decoder(Record, dec_hook=unpack_array)
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


def pack_array(value: object) -> tuple[str, tuple[int, ...], bytes]:
    """An array as type, shape and bytes, for msgpack."""
    if not isinstance(value, np.ndarray):
        raise NotImplementedError(f"cannot record a {type(value).__name__}")
    return value.dtype.str, value.shape, value.tobytes()


def unpack_array(kind: type, packed: Any) -> object:
    """The array of type, shape and bytes."""
    if get_origin(kind) is not np.ndarray:
        raise NotImplementedError(f"cannot read a {kind}")
    dtype, shape, data = packed
    return np.frombuffer(data, dtype).reshape(shape).copy()


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPerson:
    """One person in all frames so far."""

    estimates: list[Estimate]
    state: PersonState  # after the last frame

    def outcome(self, up: Array | None) -> Outcome:
        """The person at the end of these frames; `up` (3,) is the direction away from the floor."""
        state = self.state
        return Outcome(state.start, state.shape, state.stature_deviation, up, Tally.of(self.estimates))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Recorded(RunTotals):
    """At least one frame, and the run until the last of them."""

    people: list[RecordedPerson]
    frame: FrameState  # after the last frame
    end: int  # bytes of complete records

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.people[0].estimates)

    @property
    def state(self) -> TrackerState:
        """The state of the tracker after the last frame."""
        return TrackerState([person.state for person in self.people], self.frame)


def read_log(path: Path) -> Recorded | None:
    """Read a log; None if it has no frame. Raises InputError if it has another format."""
    openings: list[Opening] = []
    last: Entry | None = None
    starts: list[Start | None] = []
    scenes = dict[str, Scene]()
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
                estimates = [[] for _ in starts]
            last = record
            for camera, change in record.frame.scene_changes.items():
                scenes.setdefault(camera, Scene(SceneSettings())).restore(change)
            for estimates_of_person, estimate in zip(estimates, record.estimates, strict=True):
                estimates_of_person.append(estimate)
    if last is None:
        return None
    people = []
    for p, start in enumerate(starts):
        assert start is not None  # it is recorded with the first frame
        people.append(RecordedPerson(estimates[p], PersonState(start, last.checkpoints[p])))
    return Recorded(
        configuration=openings[-1].configuration,
        statistics=last.statistics,
        seconds=last.seconds,
        resumes=len(openings) - 1,
        people=people,
        frame=replace(
            last.frame, scene_changes={camera: scene.whole_change() for camera, scene in scenes.items()}
        ),
        end=end,
    )


def floor_up(scenes: SceneChanges) -> Array | None:
    """Up direction (3,) from the floor of the first camera that sees one; None without a floor."""
    for scene in scenes.values():
        if scene.has_floor:
            return np.asarray(scene.T_rig_camera[:3, :3] @ Planes(scene.planes, has_floor=True).up)
    return None


def assemble(
    model: BodyModel,
    estimates: Iterable[Estimate],
    *,
    held: Mapping[str, float] | None = None,
    up: Array | None = None,
    tally: Tally | None = None,
    new: NewArray = np.empty,
) -> Track:
    """The track of a run's estimates, in their order.

    `held` are the values of held degrees of freedom by name; zero if missing. `up` (3,) is the direction away
    from the ground, camera frame; None if unknown. If `estimates` can be read only once, `tally` must be
    that of all of them. `new` allocates the arrays.
    """
    if tally is None:
        estimates = list(estimates)
        tally = Tally.of(estimates)
    frames, dofs, joints = tally.frames, len(model.dof_names), len(model.joint_names)
    longest = max((len(kind) for faults in tally.faults.values() for kind, _ in faults), default=1)
    track = Track(
        frame=new((frames,), np.int64),
        time_s=new((frames,), np.float64),
        dof_names=model.dof_names,
        pose=new((frames, dofs), np.float64),
        joint_names=model.joint_names,
        joint_positions=new((frames, joints, 3), np.float64),
        joint_deviation=new((frames, joints), np.float64),
        joint_off_probability=new((frames, joints), np.float64),
        joint_seen=new((frames, joints), np.float64),
        hypothesis_pose=new((frames, tally.hypotheses, dofs), np.float64),
        hypothesis_weight=new((frames, tally.hypotheses), np.float64),
        status=new((frames,), np.dtype("<U9")),
        angle_names=(),
        angle=np.empty((frames, 0)),
        angle_deviation=np.empty((frames, 0)),
        up=up,
        camera_names=(cameras := tally.cameras) or None,
        joint_seen_by=new((frames, len(cameras), joints), np.float64) if cameras else None,
        camera_fault=new((frames, len(cameras)), np.dtype(f"<U{longest}")) if cameras else None,
        keypoint=new((frames, max(1, len(cameras)), 17, 3), np.float64) if tally.keypoints else None,
    )
    for f, estimate in enumerate(estimates):
        enter(track, f, estimate)
    return with_angles(track, angles_of(model, held, up), new)


def enter(track: Track, f: int, estimate: Estimate) -> None:
    """Write the estimate of frame `f` into the arrays of a track, all except the angles."""
    track.frame[f], track.time_s[f], track.status[f] = estimate.frame, estimate.time_s, estimate.status
    track.pose[f], track.joint_positions[f] = estimate.pose, estimate.joint_positions
    certainty, count = estimate.certainty, len(estimate.hypothesis_weight)
    track.joint_deviation[f], track.joint_seen[f] = certainty.deviation, certainty.seen
    track.joint_off_probability[f] = certainty.off_probability
    track.hypothesis_weight[f, :count] = estimate.hypothesis_weight
    track.hypothesis_pose[f, :count] = estimate.hypothesis_pose
    track.hypothesis_weight[f, count:] = track.hypothesis_pose[f, count:] = np.nan
    if track.keypoint is not None:
        for c, name in enumerate(track.camera_names or ("",)):
            track.keypoint[f, c] = estimate.keypoints.get(name, np.nan)
    if track.camera_names and track.joint_seen_by is not None and track.camera_fault is not None:
        for c, name in enumerate(track.camera_names):
            track.joint_seen_by[f, c] = estimate.seen_by.get(name, 0.0)
            track.camera_fault[f, c] = estimate.faults.get(name, ("", 0.0))[0]
