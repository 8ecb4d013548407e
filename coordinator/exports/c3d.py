"""C3D: joints as points and angles beside them, for motion capture programs. Written by ezc3d.

Points are in millimetres and OpenSim's axes (x forward, y up, z to the person's right). Their residual is
their standard deviation in millimetres. Angles, in degrees, follow the convention of the format: one point
per joint with flexion, abduction and rotation as its values, listed under ANGLES. The format has a constant
frame rate: missing and lost frames have no values.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import BinaryIO

import numpy as np
from ezc3d import c3d

from gepf.common.arrays import Array
from gepf.coordinator.bodies.families import angles_of
from gepf.coordinator.exports.axes import CAMERA_TO_OPENSIM
from gepf.coordinator.exports.recorded import RecordedRun


def write_c3d(run: RecordedRun, file: BinaryIO) -> None:
    """All frames from the first to the last, at the run's rate."""
    times = run.seconds - run.seconds[0]
    every = np.rint(times * run.rate).astype(np.int64)  # index of each frame among evenly spaced ones
    slots, count = every[~run.track.unknown], int(every[-1]) + 1
    joints = run.track.joint_positions @ run.from_camera(CAMERA_TO_OPENSIM).T * 1000.0
    names, angles = angle_points(run)
    points = np.full((3, len(run.track.joint_names) + len(names), count), np.nan)
    points[:, : joints.shape[1], slots] = joints[~run.track.unknown].transpose(2, 1, 0)
    points[:, joints.shape[1] :, slots] = angles[~run.track.unknown].transpose(2, 1, 0)
    residuals = np.full((1, points.shape[1], count), -1.0)  # where a point has no place
    residuals[:, :, slots] = 0.0
    off = run.track.joint_deviation[~run.track.unknown] * 1000.0
    residuals[0, : joints.shape[1], slots] = np.nan_to_num(off)

    content = c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [run.rate]
    content["parameters"]["POINT"]["LABELS"]["value"] = [*run.track.joint_names, *names]
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    content.add_parameter("POINT", "ANGLES", names)
    content.add_parameter("POINT", "ANGLE_UNITS", ["deg"])
    content.add_parameter("POINT", "X_SCREEN", ["+Z"])
    content.add_parameter("POINT", "Y_SCREEN", ["+Y"])
    content.add_parameter("MANUFACTURER", "SOFTWARE", ["gepf"])
    content.add_parameter("MANUFACTURER", "REMARK", [run.remark])
    content["data"]["points"] = np.concatenate([points, np.ones((1, *points.shape[1:]))])
    content["data"]["meta_points"]["residuals"] = residuals
    with tempfile.TemporaryDirectory() as folder:  # ezc3d writes to a path only
        draft = Path(folder) / "run.c3d"
        content.write(str(draft))
        file.write(draft.read_bytes())


def angle_points(run: RecordedRun) -> tuple[list[str], Array]:
    """Names and values (F, N, 3) in degrees: three per spherical joint; one and zeros per revolute joint."""
    body, values = run.body(), np.degrees(run.track.angle)
    angles = angles_of(body.model, body.held, run.track.up)
    first = 3 * len(angles.spherical)
    balls = values[:, :first].reshape(len(values), -1, 3)
    hinges = np.stack([values[:, first:], *[np.zeros_like(values[:, first:])] * 2], axis=-1)
    names = [f"{ball.names[-1].rpartition('_')[0]}_angles" for ball in angles.spherical]
    return names + [hinge.name for hinge in angles.revolute], np.concatenate([balls, hinges], axis=1)
