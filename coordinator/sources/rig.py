"""A rig: several cameras with known poses, listed in a JSON file with the sequence of each."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from gepf.common.arrays import Array
from gepf.common.bounds import LARGEST, MAX_CAMERAS
from gepf.common.camera import is_rigid
from gepf.common.errors import InputError
from gepf.coordinator.files import read_json, write_json
from gepf.coordinator.sources.camera import AS_RECORDED, GivenCamera
from gepf.coordinator.sources.devices.device import vendor_of
from gepf.coordinator.sources.live_stream import LIMITS, LiveCamera, is_topic, live_key
from gepf.coordinator.sources.source import RigSource

logger = logging.getLogger(__name__)

Row = Annotated[list[float], Meta(min_length=4, max_length=4)]
Matrix = Annotated[list[Row], Meta(min_length=4, max_length=4)]
RIG_FILE = "rig.json"
EXAMPLE = '{"cameras": [{"name": "front", "sequence": "front/", "T_rig_camera": [[1, 0, 0, 0], ...]}, ...]}'


class RigCamera(msgspec.Struct, frozen=True):
    """A camera of a rig file."""

    name: str
    sequence: str  # a path, relative to the file
    T_rig_camera: Matrix  # metres
    time_offset_s: float = 0.0  # added to the camera's time it gives the rig's

    @property
    def pose(self) -> Array:
        """T_rig_camera (4, 4), with an exact rotation."""
        matrix = np.array(self.T_rig_camera)
        left, _, right = np.linalg.svd(matrix[:3, :3])
        if np.abs(left @ right - matrix[:3, :3]).max() > 1e-12:
            matrix[:3, :3] = left @ right
        return matrix


class RigFile(msgspec.Struct, frozen=True):
    """A rig file. Other entries, such as deviations, are not read."""

    cameras: list[RigCamera]


def read_rig_file(path: Path) -> RigFile:
    """Read the cameras of a rig; InputError if there are none, or if one of them is invalid."""
    rig = read_json(path, RigFile, f"write {EXAMPLE}")
    if not 1 <= len(rig.cameras) <= MAX_CAMERAS:
        raise InputError(f"{path} lists {len(rig.cameras)} cameras; give 1 to {MAX_CAMERAS}")
    for camera in rig.cameras:
        if (wrong := find_fault(camera)) is not None:
            raise InputError(f"{path}: {wrong}")
    for one, other in combinations(rig.cameras, 2):
        if one.name == other.name:
            raise InputError(f"{path} has two cameras named '{one.name}'; rename one")
        if sequence_of(path, one) == sequence_of(path, other):
            twice = f"lists {one.sequence} twice, as '{one.name}' and '{other.name}'"
            raise InputError(f"{path} {twice}; remove one")
    return rig


def find_fault(camera: RigCamera) -> str | None:
    """What is wrong with a camera by itself; None if nothing is."""
    name, matrix = camera.name, np.array(camera.T_rig_camera)
    if not name:
        return "a camera has an empty name; give it a name"
    if not is_rigid(matrix):
        moved = f"T_rig_camera of '{name}' is not a rotation and a translation in metres"
        return f"{moved}; give 4 rows of 4 numbers, the last 0 0 0 1"
    if (away := np.linalg.norm(matrix[:3, 3])) > 100.0:  # metres; no rig is so large
        return f"T_rig_camera of '{name}' puts it {away:.0f} m away; give metres, not millimetres"
    if abs(camera.time_offset_s) > LARGEST:
        return f"time_offset_s of '{name}' is not in seconds; correct it"
    return None


def sequence_of(path: Path, camera: RigCamera) -> Path:
    """The recording of a camera of the file at `path`."""
    return (path.parent / camera.sequence).resolve()


def live_cameras(sequence: Path) -> tuple[LiveCamera, ...]:
    """The camera of `zenoh:KEY` or `ros2:/TOPIC`, or those of a rig file with such keys; none for recordings.

    InputError for an invalid key, and for a rig with live cameras and recordings, or with topics.
    """
    if (key := live_key(sequence)) is not None:
        return (LiveCamera(key),)
    if sequence.suffix.lower() != ".json" or not sequence.is_file():
        return ()
    listed = read_rig_file(sequence).cameras
    for camera in listed:
        if vendor_of(camera.sequence):
            given = f"gepf publish {camera.sequence} --key KEY, and zenoh:KEY in the rig"
            raise InputError(f"{sequence}: '{camera.name}' is read by its vendor's SDK; use {given}")
    keys = [live_key(Path(camera.sequence)) for camera in listed]
    if any(map(is_topic, keys)):
        raise InputError(f"{sequence}: cameras of ROS 2 are tracked alone; give ros2:/TOPIC, not a rig")
    if any(keys) and None in keys:
        odd = listed[keys.index(None)]
        raise InputError(f"{sequence}: '{odd.name}' is a recording, but others are live; list only one kind")
    return tuple(
        LiveCamera(key, camera.name, camera.pose, camera.time_offset_s)
        for key, camera in zip(keys, listed, strict=True)
        if key is not None
    )


def read_rig(path: Path, given: GivenCamera) -> RigSource:
    """Open the recordings of a rig as one source."""
    from gepf.coordinator.sources import open_recording

    if given != AS_RECORDED:
        raise InputError(
            f"--intrinsics, --depth-scale and --mirrored cannot be used with a rig, {path}; leave them out"
        )
    if live_cameras(path):
        raise InputError(f"the cameras of {path} are live; use gepf track, or gepf.live in Python")
    cameras = []
    for camera in read_rig_file(path).cameras:
        recording, pose = sequence_of(path, camera), camera.pose
        if recording.suffix.lower() == ".json" and recording.is_file():
            raise InputError(f"{path}: '{camera.name}' is a rig itself; list its cameras instead")
        try:
            source = open_recording(recording)
        except InputError as error:
            raise InputError(f"{path}: '{camera.name}': {error}") from error
        gravity = None if source.gravity is None else pose[:3, :3] @ source.gravity
        named = source.changed(camera=camera.name, T_rig_camera=pose, gravity=gravity)
        cameras.append(named.changed(offset_s=camera.time_offset_s))
        first, last = (each.times_s for each in (cameras[0], cameras[-1]))
        if last[0] > first[-1] or last[-1] < first[0]:
            apart = f"'{camera.name}' and '{cameras[0].camera}' were not recorded at the same time"
            raise InputError(f"{path}: {apart}; correct time_offset_s, or remove one")
    head, longest = cameras[0], max(cameras, key=lambda each: each.times_s[-1])
    if (rest := longest.times_s[-1] - head.times_s[-1]) > LIMITS.silent_intervals / head.fps:
        ends = f"'{head.camera}' ends {rest:.1f} s before '{longest.camera}'"
        logger.warning("%s: %s; to track the rest, list '%s' first", path, ends, longest.camera)
    return RigSource.of(path.stem, cameras)


def write_rig(path: Path, cameras: list[RigCamera], deviations: Mapping[str, object] | None = None) -> None:
    """Write a rig file, with the standard deviations of the poses by camera if they are known."""
    write_json(path, {"cameras": cameras} | ({"deviations": deviations} if deviations else {}))
