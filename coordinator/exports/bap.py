"""MPEG-4 body animation parameters (ISO/IEC 14496-2, Annex C) as text: re-animates any MPEG-4 body.

The first line is `3.1 NAME RATE FRAMES`: version 3.1 has 186 parameters. Each frame has two lines: a mask of
186 zeros and ones, and the frame's number from 0 followed by the values whose mask is one. Values are
whole: angles in units of 1e-5 radians, the root's translation in millimetres.

Axes and signs are the standard's: x to the body's left, y up, z to its front, all three of a body that
stands at turn 0 and faces the camera, and each angle turns about the axis that the standard gives it, the
same one on both sides of the body. A joint's angles apply in the order of their numbers, the first
outermost, so the root's turn, roll, tilt. Frames in which the tracker was lost have an empty mask, with
which a decoder keeps the last posture.
"""

from __future__ import annotations

import io
import warnings
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from common.body import ROOT_DOFS
from common.errors import InputError
from coordinator.bodies.human.dofs import BODY_ANIMATION_PARAMETERS, ROOT_PARAMETERS
from coordinator.exports.recorded import CAMERA_TO_Y_UP, RecordedRun

Array = NDArray[np.float64]

VERSION = "3.1"
ANGLE_UNIT = 1e-5  # radians
LENGTH_UNIT = 1e-3  # metres
ROOT_ORDER = "YZX"  # turn, roll, tilt

_SPINE = {"tilt": -1, "torsion": 1, "roll": 1}
_LIMBS = {
    # left, right: whether the standard's axis agrees with that of this project's body
    "hip_flexion": (1, 1), "hip_abduct": (1, -1), "hip_twisting": (1, -1),
    "knee_flexion": (-1, -1), "knee_twisting": (1, -1),
    "ankle_flexion": (1, 1), "ankle_twisting": (1, -1),
    "subtalar_flexion": (-1, 1), "midtarsal_twisting": (-1, 1), "metatarsal_flexion": (1, 1),
    "sternoclavicular_abduct": (1, -1), "sternoclavicular_rotate": (-1, 1),
    "acromioclavicular_abduct": (1, -1), "acromioclavicular_rotate": (-1, 1),
    "shoulder_flexion": (1, 1), "shoulder_abduct": (1, -1), "shoulder_twisting": (1, -1),
    "elbow_flexion": (1, 1), "elbow_twisting": (1, -1),
    "wrist_flexion": (1, -1), "wrist_pivot": (1, 1), "wrist_twisting": (1, -1),
}  # fmt: skip


def sign_of(dof: str) -> int:
    """1 or -1: by what this project's angle is multiplied to get the standard's. Fingers keep theirs."""
    side, _, stem = dof.partition("_")
    if side in ("l", "r"):
        left, right = _LIMBS.get(stem, (1, 1))
        return left if side == "l" else right
    return _SPINE[dof.rpartition("_")[2]]


def write_bap(run: RecordedRun, file: BinaryIO) -> None:
    """All frames of a person; InputError for any other body."""
    values = parameters_of(run)
    numbers = sorted(values)
    table = np.stack([values[number] for number in numbers], axis=1)  # (F, P)
    mask = " ".join("1" if number in values else "0" for number in range(1, 187))
    name = "_".join(run.name.split()) or "run"
    text = io.TextIOWrapper(file, encoding="utf-8", newline="\n")
    text.write(f"{VERSION} {name} {run.rate:g} {len(table)}\n")
    for f, row in enumerate(table.tolist()):
        if run.lost[f]:
            text.write(" ".join("0" * 186) + f"\n{f}\n")
        else:
            text.write(f"{mask}\n{f} {' '.join(map(str, row))}\n")
    text.detach()


def parameters_of(run: RecordedRun) -> dict[int, NDArray[np.int64]]:
    """Parameter number -> its values (F,), for what moves, what is held away from zero, and the root."""
    angles = angles_of(run)
    found = root_parameters(angles, len(run.track.frame), run.to_y_up)
    for number, dof in BODY_ANIMATION_PARAMETERS.items():
        if dof in angles:
            found[number] = whole(sign_of(dof) * angles[dof], ANGLE_UNIT)
    return found


def angles_of(run: RecordedRun) -> dict[str, Array]:
    """Degree of freedom -> its values (F,); InputError if they are not those of an MPEG-4 body."""
    body, track = run.body(), run.track
    held = {name: np.full(len(track.frame), value) for name, value in body.held.items()}
    angles = {**held, **{name: track.pose[:, d] for d, name in enumerate(track.dof_names)}}
    known = {*BODY_ANIMATION_PARAMETERS.values(), *ROOT_DOFS}
    stranger = next((name for name in angles if name not in known), None)
    if stranger is not None:
        raise InputError(
            f"MPEG-4 describes people, not a body with '{stranger}'; choose bvh, csv, glb, json or trc"
        )
    if any(name.startswith("sacroiliac_") for name in angles):
        raise InputError(
            "MPEG-4 hangs the legs from the sacroiliac joint, this body its trunk; "
            "track vl5_tilt, vl5_torsion, vl5_roll instead, or choose another format"
        )
    return angles


def root_parameters(angles: dict[str, Array], frames: int, to_y_up: Array) -> dict[int, NDArray[np.int64]]:
    """The six parameters of the root: where it is, and how it is turned, in the standard's axes."""
    values = np.stack([angles.get(name, np.zeros(frames)) for name in ROOT_DOFS], axis=1)  # (F, 6)
    lateral, vertical, frontal = (values[:, :3] @ to_y_up.T).T
    turns = to_y_up @ Rotation.from_euler("XYZ", values[:, 3:]).as_matrix() @ CAMERA_TO_Y_UP
    with warnings.catch_warnings():  # at 90 degrees one angle of three is free, and any will do
        warnings.filterwarnings("ignore", message="Gimbal lock")
        turn, roll, tilt = np.unwrap(Rotation.from_matrix(turns).as_euler(ROOT_ORDER), axis=0).T
    places = {"tr_vertical": vertical, "tr_lateral": lateral, "tr_frontal": frontal}
    rotations = {"rt_body_turn": turn, "rt_body_roll": roll, "rt_body_tilt": tilt}
    number = {name: n for n, name in ROOT_PARAMETERS.items()}
    return {number[name]: whole(value, LENGTH_UNIT) for name, value in places.items()} | {
        number[name]: whole(value, ANGLE_UNIT) for name, value in rotations.items()
    }


def whole(values: Array, unit: float) -> NDArray[np.int64]:
    """Values in whole units."""
    return np.rint(values / unit).astype(np.int64)
