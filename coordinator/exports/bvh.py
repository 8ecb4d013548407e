"""Biovision hierarchy: the skeleton with its motion, for animation programs.

Centimetres and degrees, y up, a person who faces the camera looks along +z; the origin is the camera's.
Angles go Z, X, Y. Joints that slide have positions too, and then an offset of zero, since readers differ
in whether positions add to it. Lost frames hold what the tracker reported.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from coordinator.exports.bones import Bone, bones_of, children, motion_of, offset
from coordinator.exports.recorded import RecordedRun

Array = NDArray[np.float64]

CENTIMETRES = 100.0
ORDER = "ZXY"
TIP = "0.000000 5.000000 0.000000"  # centimetres from the last joint of a limb to the end of its bone


def write_bvh(run: RecordedRun, file: BinaryIO) -> None:
    """The skeleton in its rest pose, and every frame's motion."""
    model = run.body().model
    bones = bones_of(model)
    turns, places = motion_of(model, bones, run.track.pose, run.to_y_up)
    order = list(walk(bones, 0))
    columns = [channels(bones[b], turns[:, b], places[:, b]) for b in order]
    text = io.TextIOWrapper(file, encoding="ascii", newline="\n")
    text.write("HIERARCHY\n")
    text.writelines(hierarchy(bones, 0, 0))
    text.write(f"MOTION\nFrames: {len(turns)}\nFrame Time: {1.0 / run.rate:.9f}\n")
    np.savetxt(text, np.concatenate(columns, axis=1), fmt="%.6f")
    text.detach()


def walk(bones: tuple[Bone, ...], b: int) -> Iterator[int]:
    """Bones in the order in which the file names them."""
    yield b
    for child in children(bones, b):
        yield from walk(bones, child)


def hierarchy(bones: tuple[Bone, ...], b: int, depth: int) -> Iterator[str]:
    """Lines of a bone and all that hangs from it."""
    bone, indent = bones[b], "\t" * depth
    moves = positioned(bone)
    place = np.zeros(3) if moves else offset(bones, bone)
    yield f"{indent}{'JOINT' if depth else 'ROOT'} {bone.name}\n{indent}{{\n"
    yield f"{indent}\tOFFSET {' '.join(f'{CENTIMETRES * value:.6f}' for value in place)}\n"
    names = [f"{axis}position" for axis in "XYZ" if moves] + [f"{axis}rotation" for axis in ORDER]
    yield f"{indent}\tCHANNELS {len(names)} {' '.join(names)}\n"
    below = children(bones, b)
    for child in below:
        yield from hierarchy(bones, child, depth + 1)
    if not below:
        yield f"{indent}\tEnd Site\n{indent}\t{{\n{indent}\t\tOFFSET {TIP}\n{indent}\t}}\n"
    yield f"{indent}}}\n"


def positioned(bone: Bone) -> bool:
    """Whether a bone has channels for its position."""
    return bone.parent < 0 or bone.slides


def channels(bone: Bone, turns: Array, places: Array) -> Array:
    """Values (F, 3 or 6) of a bone's channels, angles without jumps of a turn."""
    with warnings.catch_warnings():  # at 90 degrees one angle of three is free, and any will do
        warnings.filterwarnings("ignore", message="Gimbal lock")
        angles = Rotation.from_matrix(turns).as_euler(ORDER, degrees=True)
    angles = np.unwrap(angles, period=360.0, axis=0)
    return np.concatenate([places * CENTIMETRES, angles], axis=1) if positioned(bone) else angles
