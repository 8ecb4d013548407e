"""The result of a run: the contents of `track.npz` and `model.npz`."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import BodyModel
from gepf.common.errors import InputError
from gepf.coordinator.files import LIVE_FILE, LOG_FILE, file_layout, read_arrays
from gepf.coordinator.settings import CertaintySettings
from gepf.coordinator.tracking.estimate import POSE_UNKNOWN

TRACK_FILE = "track.npz"

NewArray = Callable[[tuple[int, ...], Any], NDArray[Any]]
"""Makes an array of a shape and a type, such as `np.empty`."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The content of `track.npz`: F frames, D degrees of freedom, J joints, A angles, C cameras of a rig.

    Metres and radians, in the frame of the camera or rig. Frames have up to M hypotheses; missing
    ones are NaN. Each field has the layout of its array.
    """

    frame: Annotated[Indices, "whole numbers (F)"]
    time_s: Annotated[Array, "numbers (F)"]
    dof_names: Annotated[tuple[str, ...], "names (D)"]
    pose: Annotated[Array, "numbers (F, D)"]
    joint_names: Annotated[tuple[str, ...], "names (J)"]
    joint_positions: Annotated[Array, "numbers (F, J, 3)"]
    hypothesis_pose: Annotated[Array, "numbers (F, M, D)"]
    hypothesis_weight: Annotated[Array, "numbers (F, M)"]
    status: Annotated[NDArray[np.str_], "texts (F)"]  # tracked, ambiguous, lost, searching or absent
    joint_deviation: Annotated[Array, "numbers (F, J)"]  # one standard deviation; NaN where unknown
    joint_off_probability: Annotated[Array, "numbers (F, J)"]  # of an error above 15 cm; NaN if unknown
    joint_seen: Annotated[Array, "numbers (F, J)"]  # visible share of its surface; NaN if unknown
    angle_names: Annotated[tuple[str, ...], "names (A)"]
    angle: Annotated[Array, "numbers (F, A)"]  # continuous from frame to frame
    angle_deviation: Annotated[Array, "numbers (F, A)"]  # one standard deviation; NaN where unknown
    up: Annotated[Array | None, "?numbers (3)"] = None  # unit vector away from the ground; None if unknown
    camera_names: Annotated[tuple[str, ...] | None, "?names (C)"] = None
    joint_seen_by: Annotated[Array | None, "?numbers (F, C, J)"] = None  # joint_seen for each camera
    camera_fault: Annotated[NDArray[np.str_] | None, "?texts (F, C)"] = None  # empty if there is none
    keypoint: Annotated[Array | None, "?numbers (F, V, 17, 3)"] = None
    """In the colour image of each camera (V; one without a rig): column, row, inverse variance (pixels^-2).
    NaN where there are none; None if no frame has any."""

    @property
    def unknown(self) -> Mask:
        """Frames (F,) without a known pose: the body is lost, searched for, or absent."""
        return np.asarray(np.isin(self.status, POSE_UNKNOWN))

    @property
    def flagged(self) -> Mask:
        """Joints (F, J) that may be wrong, by the usual limit of their probability."""
        return np.asarray(self.joint_off_probability > CertaintySettings().flagged_probability)

    @property
    def placed(self) -> Mask:
        """Frames (F,) with a pose, also a guessed one: all after the body was found."""
        return np.asarray(np.isfinite(self.pose).all(axis=1))

    def part(self, frames: slice) -> Track:
        """Some of the frames; arrays are views."""
        values = {name: getattr(self, name) for name in _of_frames()}
        return replace(self, **{name: value[frames] for name, value in values.items() if value is not None})

    def parts(self, count: int) -> Iterator[Track]:
        """All frames in order, in parts of at most `count`."""
        for first in range(0, len(self.frame), count):
            yield self.part(slice(first, first + count))

    def stretches(self) -> list[tuple[str, int, int]]:
        """All intervals of successive frames of one status: status, first and last index."""
        found, first = [], 0
        for status, members in groupby(self.status.tolist()):
            count = len(list(members))
            found.append((status, first, first + count - 1))
            first += count
        return found


@cache
def _of_frames() -> tuple[str, ...]:
    """The fields of a track that have a value for each frame."""
    return tuple(name for name, layout in file_layout(Track).items() if "(F" in layout)


def filled(track: Track) -> Track:
    """The track with the first found pose also in the frames before it; zeros if there is none."""
    if track.placed.all():
        return track
    if not track.placed.any():
        return where_missing(track, ~track.placed, lambda _: 0.0)
    first = int(np.argmax(track.placed))
    return filled_from(track, track.part(slice(first, first + 1)))


def filled_from(track: Track, found: Track) -> Track:
    """The track with the pose, joints and angles of a single frame `found` in the frames without a pose."""
    missing = ~track.placed
    if not missing.any():
        return track
    changed = {name: getattr(track, name).copy() for name in ("pose", "joint_positions", "angle")}
    for name, values in changed.items():
        values[missing] = getattr(found, name)[0]
    return replace(track, **changed)


def where_missing(track: Track, missing: Mask, value: Callable[[Array], Array | float]) -> Track:
    """The track with pose, joints and angles replaced by `value` of the field in some frames (F,)."""
    changed = {name: getattr(track, name).copy() for name in ("pose", "joint_positions", "angle")}
    for name, values in changed.items():
        values[missing] = value(getattr(track, name))
    return replace(track, **changed)


def write_track(track: Track, file: BinaryIO, *, packed: bool = False) -> None:
    """Write a track as `.npz`; equal tracks give equal bytes (no compression, no dates).

    With `packed` it is compressed, as most of a long run would be padding: every frame has room for the
    largest number of hypotheses. Its bytes then depend on the version of zlib.
    """
    values: dict[str, Any] = {f.name: getattr(track, f.name) for f in fields(Track)}
    arrays = {name: np.asarray(value) for name, value in values.items() if value is not None}
    (np.savez_compressed if packed else np.savez)(file, allow_pickle=False, **arrays)


def read_track(folder: Path) -> Track:
    """Read the track in the folder of a run; InputError if it is missing or damaged."""
    if not folder.is_dir():
        raise InputError(f"no such folder: {folder}; give the --out folder of a finished gepf track")
    if (folder / LIVE_FILE).exists():
        raise InputError(f"{folder} holds a live run that has not ended; gepf report {folder} finishes it")
    if (folder / LOG_FILE).exists():
        where = f"{folder} holds a run that has not ended or was interrupted"
        if not (folder / TRACK_FILE).exists():
            raise InputError(f"{where}; finish it with the same gepf track command and --resume")
        logger.warning("%s; only its first frames are used until gepf track --resume finishes it", where)
    if not (folder / TRACK_FILE).exists():
        people = sorted(each.parent.name for each in folder.glob(f"person*/{TRACK_FILE}"))
        if people:
            raise InputError(
                f"{folder} holds the results of several people; give one of its folders, such as "
                f"{folder / people[0]}"
            )
        inside = sorted(each.parent for each in folder.glob(f"*/{TRACK_FILE}"))
        where = f"a run in it, such as {inside[0]}" if inside else "the --out folder of a finished gepf track"
        raise InputError(f"{folder} holds no {TRACK_FILE}; give {where}")
    arrays = read_arrays(folder / TRACK_FILE, file_layout(Track))
    names = {name: tuple(values.tolist()) for name, values in arrays.items() if name.endswith("_names")}
    track = Track(**arrays | names)  # type: ignore[arg-type]
    finite = track.placed & np.isfinite(track.joint_positions).all(axis=(1, 2))
    if not np.all(finite | track.unknown):
        raise InputError(f"{folder / TRACK_FILE} holds poses that are not finite; track the sequence again")
    return track


MODEL_FILE = "model.npz"


@dataclass(frozen=True, slots=True, eq=False)
class TrackedBody:
    """A body with its active degrees of freedom, and the values of the held ones.

    `held` is by name, in radians and metres; missing values are zero.
    """

    model: BodyModel
    held: Mapping[str, float]


def write_tracked_body(body: TrackedBody, file: BinaryIO) -> None:
    """Write a body as `.npz`: the fields of `BodyModel` by name. Equal bodies give equal bytes."""
    values: dict[str, Any] = {f.name: np.asarray(getattr(body.model, f.name)) for f in fields(BodyModel)}
    held = {
        "held_names": np.array(list(body.held), dtype=np.str_),
        "held_values": np.array(list(body.held.values()), dtype=np.float64),
    }
    np.savez_compressed(file, allow_pickle=False, hash=np.array(body.model.hash), **values, **held)


def read_tracked_body(folder: Path) -> TrackedBody:
    """Read the body in the folder of a run; InputError if it is missing or damaged."""
    path = folder / MODEL_FILE
    if not path.exists():
        raise InputError(f"{folder} holds no {MODEL_FILE}; track the sequence again with this version")
    arrays = read_arrays(path)
    try:
        values = {f.name: arrays[f.name] for f in fields(BodyModel)}
        plain = {f.name: values[f.name].tolist() for f in fields(BodyModel) if "str" in str(f.type)}
        plain = {name: tuple(value) if isinstance(value, list) else value for name, value in plain.items()}
        model = BodyModel(**values | plain)
        held = dict(zip(arrays["held_names"].tolist(), arrays["held_values"].tolist(), strict=True))
        same = str(arrays["hash"]) == model.hash
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is damaged or was changed ({error}); track the sequence again") from error
    if not same:
        raise InputError(f"{path} is damaged or was changed; track the sequence again")
    return TrackedBody(model, held)
