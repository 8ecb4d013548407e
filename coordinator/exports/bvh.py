"""Biovision hierarchy: the skeleton with its motion, for animation programs.

Centimetres and degrees, y up; a person who faces the camera looks along +z; the origin is the camera. Angles
are in the order Z, X, Y. Only the root and prismatic joints also have positions, and an offset of zero,
because readers differ in whether positions are added to the offset. Lost frames have the reported pose.

The format has a constant frame rate: between the frames of the run, which may be missing or late, the bones
turn and move evenly. So the duration is that of the run.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from typing import BinaryIO

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from gepf.common.arrays import Array
from gepf.common.errors import InputError
from gepf.coordinator.exports.axes import CAMERA_TO_Y_UP
from gepf.coordinator.exports.bones import Bone, bones_of, children, motion_of, offset, slides
from gepf.coordinator.exports.recorded import RecordedRun

ORDER = "ZXY"
TIP = "0.000000 5.000000 0.000000"  # centimetres from the last joint of a limb to the end of its bone


def write_bvh(run: RecordedRun, file: BinaryIO) -> None:
    """Write the skeleton in its rest pose, and its motion at the run's rate.

    InputError for a run that lasts longer than a day.
    """
    model = run.body().model
    bones = bones_of(model)
    turns, places = motion_of(model, bones, run.track.pose, run.from_camera(CAMERA_TO_Y_UP))
    turns, places = evenly(run, turns, places)
    positioned = [bone.parent < 0 or slides(bones, bone, places[:, b]) for b, bone in enumerate(bones)]
    columns = []
    for b in walk(bones, 0):
        if positioned[b]:
            columns.append(100.0 * places[:, b])
        columns.append(angles_of(turns[:, b]))
    text = io.TextIOWrapper(file, encoding="ascii", newline="\n")
    text.write("HIERARCHY\n")
    text.writelines(hierarchy(bones, positioned, 0, 0))
    text.write(f"MOTION\nFrames: {len(turns)}\nFrame Time: {1.0 / run.rate:.9f}\n")
    np.savetxt(text, np.concatenate(columns, axis=1), fmt="%.6f")
    text.detach()


def evenly(run: RecordedRun, turns: Array, places: Array) -> tuple[Array, Array]:
    """Rotations (R, B, 3, 3) and origins (R, B, 3) of the bones at the run's rate, from all frames."""
    times = run.seconds - run.seconds[0]
    if times[-1] > 86_400.0:  # a day; the rows of a longer run would fill the memory
        raise InputError(f"the run lasts {times[-1] / 3600:.0f} h, too long for a BVH file; export it as glb")
    if len(times) == 1:
        return turns, places
    rows = np.minimum(np.arange(round(times[-1] * run.rate) + 1) / run.rate, times[-1])
    even_turns = np.empty((len(rows), *turns.shape[1:]))
    for b in range(turns.shape[1]):
        even_turns[:, b] = Slerp(times, Rotation.from_matrix(turns[:, b]))(rows).as_matrix()
    columns = places.reshape(len(times), -1).T
    even_places = np.stack([np.interp(rows, times, column) for column in columns], axis=1)
    return even_turns, even_places.reshape(len(rows), *places.shape[1:])


def walk(bones: tuple[Bone, ...], b: int) -> Iterator[int]:
    """Bones in the order of the file."""
    yield b
    for child in children(bones, b):
        yield from walk(bones, child)


def hierarchy(bones: tuple[Bone, ...], positioned: Sequence[bool], b: int, depth: int) -> Iterator[str]:
    """Lines of a bone and its descendants; `positioned` bones have positions as channels."""
    bone, indent = bones[b], "\t" * depth
    place = np.zeros(3) if positioned[b] else 100.0 * offset(bones, bone)
    yield f"{indent}{'JOINT' if depth else 'ROOT'} {bone.name}\n{indent}{{\n"
    yield f"{indent}\tOFFSET {' '.join(f'{value:.6f}' for value in place)}\n"
    names = [f"{axis}position" for axis in "XYZ" if positioned[b]] + [f"{axis}rotation" for axis in ORDER]
    yield f"{indent}\tCHANNELS {len(names)} {' '.join(names)}\n"
    below = children(bones, b)
    for child in below:
        yield from hierarchy(bones, positioned, child, depth + 1)
    if not below:
        yield f"{indent}\tEnd Site\n{indent}\t{{\n{indent}\t\tOFFSET {TIP}\n{indent}\t}}\n"
    yield f"{indent}}}\n"


def angles_of(turns: Array) -> Array:
    """Angles (F, 3) of rotations (F, 3, 3), degrees, without jumps by full turns."""
    # at 90 degrees one angle of three is free, and any will do
    angles = Rotation.from_matrix(turns).as_euler(ORDER, degrees=True, suppress_warnings=True)
    return np.unwrap(angles, period=360.0, axis=0)
