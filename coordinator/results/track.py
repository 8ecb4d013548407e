"""The result of a run: what `track.npz` and `model.npz` hold."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.errors import InputError
from coordinator.files import LOG_FILE, ArrayFile, read_arrays
from coordinator.tracking.estimate import UNKNOWN

Array = NDArray[np.float64]

TRACK_FILE = "track.npz"
USUAL_RATE_HZ = 30.0  # frames a second, where time stamps do not say

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Poses, joints, hypotheses and status of F frames; metres and radians, camera frame.

    Frames have up to M hypotheses; where a frame has fewer, the rest is NaN.
    """

    frame: NDArray[np.int64]  # (F,)
    time_s: NDArray[np.float64]  # (F,)
    dof_names: tuple[str, ...]  # (D,)
    pose: NDArray[np.float64]  # (F, D)
    joint_names: tuple[str, ...]  # (J,)
    joint_positions: NDArray[np.float64]  # (F, J, 3)
    hypothesis_pose: NDArray[np.float64]  # (F, M, D)
    hypothesis_weight: NDArray[np.float64]  # (F, M)
    status: NDArray[np.str_]  # (F,) tracked, ambiguous, lost, searching or absent
    joint_deviation: NDArray[np.float64] | None = None  # (F, J) one standard deviation; NaN where unknown
    joint_off_probability: NDArray[np.float64] | None = None  # (F, J) of more than 15 cm; NaN where unknown
    joint_seen: NDArray[np.float64] | None = None  # (F, J) share of its surface; NaN where unknown
    angle_names: tuple[str, ...] | None = None  # (A,)
    angle: NDArray[np.float64] | None = None  # (F, A) radians, continuous from frame to frame
    angle_deviation: NDArray[np.float64] | None = None  # (F, A) one standard deviation; NaN where unknown
    particles_answered: NDArray[np.int64] | None = None  # (F,) when the frame was due; None if never
    up: NDArray[np.float64] | None = None  # (3,) unit vector away from the ground; None where it is not known

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Frames (F,) whose pose is not known: the body is lost, searched for, or not there."""
        return np.asarray(np.isin(self.status, UNKNOWN))

    @property
    def placed(self) -> NDArray[np.bool_]:
        """Frames (F,) that have a pose, be it the last that was known: all but those before the body came."""
        return np.asarray(np.isfinite(self.pose).all(axis=1))

    def stretches(self) -> list[tuple[str, int, int]]:
        """All stretches of frames of one status, in order: the status, first and last position."""
        found, first = [], 0
        for status, members in groupby(self.status.tolist()):
            count = len(list(members))
            found.append((status, first, first + count - 1))
            first += count
        return found


def filled(track: Track) -> Track:
    """The track with the first pose that was found in the frames before it; zeros where none ever was."""
    if track.placed.all():
        return track
    first = int(np.argmax(track.placed))
    return where_missing(track, ~track.placed, lambda values: values[first] if track.placed.any() else 0.0)


def emptied(track: Track, placed: NDArray[np.bool_]) -> Track:
    """The track with NaN for pose, joints and angles of the frames (F,) that are not `placed`."""
    return where_missing(track, ~placed, lambda _: np.nan)


def where_missing(track: Track, missing: NDArray[np.bool_], value: Callable[[Array], Array | float]) -> Track:
    """The track with another pose, joints and angles in some frames (F,): what `value` makes of the field."""
    changed: dict[str, Any] = {}
    for name in ("pose", "joint_positions", "angle"):
        values = getattr(track, name)
        if values is not None:
            changed[name] = values.copy()
            changed[name][missing] = value(values)
    return replace(track, **changed)


def write_track(track: Track, file: BinaryIO) -> None:
    """Write the `.npz` form; equal tracks give equal bytes (nothing compressed, no dates)."""
    values: dict[str, Any] = {f.name: getattr(track, f.name) for f in fields(Track)}
    arrays = {name: np.asarray(value) for name, value in values.items() if value is not None}
    np.savez(file, allow_pickle=False, **arrays)


def read_track(folder: Path) -> Track:
    """The track of a run's folder; InputError if there is none or it is damaged."""
    if not folder.is_dir():
        raise InputError(f"no such folder: {folder}; give the --out folder of a finished gepf track")
    if (folder / LOG_FILE).exists():
        where = f"{folder} holds a run that is still going on or was interrupted"
        if not (folder / TRACK_FILE).exists():
            raise InputError(f"{where}; end it by the same gepf track command with --resume")
        logger.warning(
            "%s, here only its first frames; the same gepf track command with --resume goes on", where
        )
    if not (folder / TRACK_FILE).exists():
        people = sorted(each.parent.name for each in folder.glob(f"person*/{TRACK_FILE}"))
        if people:
            raise InputError(f"{folder} holds several people; give one of them: {folder / people[0]}, ...")
        inside = sorted(each.parent for each in folder.glob(f"*/{TRACK_FILE}"))
        where = f"a run in it, such as {inside[0]}" if inside else "the --out folder of a finished gepf track"
        raise InputError(f"{folder} holds no {TRACK_FILE}; give {where}")
    arrays = read_arrays(folder / TRACK_FILE)
    dof_names, joint_names = arrays.names("dof_names"), arrays.names("joint_names")
    angle_names = arrays.names("angle_names") if "angle_names" in arrays else None
    frame = arrays.integers("frame", (-1,))
    weight = arrays.floats("hypothesis_weight", (len(frame), -1))
    shapes = dict.fromkeys(
        ("joint_deviation", "joint_off_probability", "joint_seen"), (len(frame), len(joint_names))
    ) | {"up": (3,)}
    if angle_names is not None:
        shapes |= dict.fromkeys(("angle", "angle_deviation"), (len(frame), len(angle_names)))
    optional: dict[str, Any] = {
        name: arrays.floats(name, shape) for name, shape in shapes.items() if name in arrays
    }
    if "particles_answered" in arrays:
        optional["particles_answered"] = arrays.integers("particles_answered", frame.shape)
    track = Track(
        frame=frame,
        time_s=arrays.floats("time_s", (len(frame),)),
        dof_names=dof_names,
        pose=arrays.floats("pose", (len(frame), len(dof_names))),
        joint_names=joint_names,
        joint_positions=arrays.floats("joint_positions", (len(frame), len(joint_names), 3)),
        hypothesis_pose=arrays.floats("hypothesis_pose", (*weight.shape, len(dof_names))),
        hypothesis_weight=weight,
        status=arrays.texts("status", (len(frame),)),
        angle_names=angle_names,
        **optional,
    )
    finite = track.placed & np.isfinite(track.joint_positions).all(axis=(1, 2))
    if not np.all(finite | track.unknown):
        raise InputError(f"{folder / TRACK_FILE} holds poses that are not finite; track the sequence again")
    return track


MODEL_FILE = "model.npz"
HASH, HELD_NAMES, HELD_VALUES = "hash", "held_names", "held_values"


@dataclass(frozen=True, slots=True, eq=False)
class TrackedBody:
    """A body with its active degrees of freedom, and where those that do not move are held.

    `held` is by name, in radians and metres; what neither moves nor is named is zero.
    """

    model: BodyModel
    held: Mapping[str, float]


def write_tracked_body(body: TrackedBody, file: BinaryIO) -> None:
    """Write the `.npz` form: the fields of `BodyModel` by name. Equal bodies give equal bytes."""
    values: dict[str, Any] = {f.name: np.asarray(getattr(body.model, f.name)) for f in fields(BodyModel)}
    held = {
        HELD_NAMES: np.array(list(body.held), dtype=np.str_),
        HELD_VALUES: np.array(list(body.held.values()), dtype=np.float64),
    }
    np.savez_compressed(file, allow_pickle=False, **{HASH: np.array(body.model.hash)}, **values, **held)


def read_tracked_body(folder: Path) -> TrackedBody:
    """The body of a run's folder; InputError if there is none or it is damaged."""
    path = folder / MODEL_FILE
    if not path.exists():
        raise InputError(f"{folder} holds no {MODEL_FILE}; track the sequence again with this version")
    arrays = read_arrays(path)
    try:
        values: dict[str, Any] = {f.name: field_of(arrays, f.name, str(f.type)) for f in fields(BodyModel)}
        model = BodyModel(**values)
    except ValueError as error:
        raise InputError(f"{path} contradicts itself ({error}); track the sequence again") from error
    if str(arrays.any(HASH)) != model.hash:
        raise InputError(f"{path} is not as it was written; track the sequence again")
    names = arrays.names(HELD_NAMES)
    held = arrays.floats(HELD_VALUES, (len(names),))
    return TrackedBody(model, dict(zip(names, held.tolist(), strict=True)))


def field_of(arrays: ArrayFile, name: str, kind: str) -> str | tuple[str, ...] | NDArray[np.generic]:
    """One field of a `BodyModel` in the type that it is declared with."""
    if kind == "str":
        return str(arrays.any(name))
    return arrays.names(name) if kind.startswith("tuple") else arrays.any(name)


def read_track_with_angles(folder: Path) -> Track:
    """The track of a run's folder; angles that it was written without follow from the body, if that is there.

    InputError if there is no track or it is damaged.
    """
    track = read_track(folder)
    if track.angle is not None or not (folder / MODEL_FILE).exists():
        return track
    from coordinator.bodies.angles import angles_of
    from coordinator.results.angles import with_angles

    body = read_tracked_body(folder)
    return with_angles(track, angles_of(body.model, body.held, track.up))
