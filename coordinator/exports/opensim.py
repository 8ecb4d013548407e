"""OpenSim's files: angles over time (`.mot`), and joints as markers (`.trc`).

A motion file first has the angles of `docs/formats.md` with their plain names, and prismatic joints in
metres. For people it also has the coordinates of the full-body model of Rajagopal et al. (2016), so that the
motion can be played on that model: rotations in the order Z, X, Y of the child in its parent, in OpenSim's
axes (x forward, y up, z to the right). These are Euler angles, which may jump for an arm that is abducted by
about 90 degrees. Lost frames are omitted.

A marker file (track row column) is in millimetres and the same axes: a person who faces the camera looks
along +x, and their right is +z; the origin is the camera. Lost frames keep their time and have no
coordinates, which means missing markers.
"""

from __future__ import annotations

import io
from typing import BinaryIO

import numpy as np
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array
from gepf.common.kinematics.rotations import euler_angles
from gepf.coordinator.bodies.angles import MIRROR, Angles, SphericalJoint
from gepf.coordinator.bodies.families import family_of
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.exports.axes import CAMERA_TO_OPENSIM
from gepf.coordinator.exports.recorded import RecordedRun
from gepf.coordinator.results.angles import sliding_joints

BALLS = {
    # a joint's first angle: OpenSim's coordinates about Z, X, Y
    "pelvis_forward_tilt": ("pelvis_tilt", "pelvis_list", "pelvis_rotation"),
    "trunk_flexion": ("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
    "right_hip_flexion": ("hip_flexion_r", "hip_adduction_r", "hip_rotation_r"),
    "left_hip_flexion": ("hip_flexion_l", "hip_adduction_l", "hip_rotation_l"),
    "right_shoulder_flexion": ("arm_flex_r", "arm_add_r", "arm_rot_r"),
    "left_shoulder_flexion": ("arm_flex_l", "arm_add_l", "arm_rot_l"),
}
HINGES = {
    "knee_flexion": "knee_angle",
    "ankle_flexion": "ankle_angle",
    "elbow_flexion": "elbow_flex",
    "elbow_twisting": "pro_sup",
}
ZXY = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # these axes as x, y, z


def write_mot(run: RecordedRun, file: BinaryIO) -> None:
    """Write one line per frame: time, the angles, and OpenSim's coordinates."""
    track, kept = run.track, ~run.track.unknown
    columns = dict(zip(track.angle_names, np.degrees(track.angle).T, strict=True))
    columns |= {name: track.pose[:, track.dof_names.index(name)] for name in sliding_joints(run.folder)}
    if family_of(run.body().model) is PEOPLE:
        columns |= opensim_coordinates(run)
    text = io.TextIOWrapper(file, encoding="utf-8", newline="\n")
    text.write(f"{run.name}\nversion=1\nnRows={kept.sum()}\nnColumns={len(columns) + 1}\ninDegrees=yes\n")
    text.write(f"\n{run.remark}\nendheader\n")
    text.write("\t".join(["time", *columns]) + "\n")
    table = np.stack([run.seconds, *columns.values()], axis=1)[kept]
    np.savetxt(text, table, fmt="%.8f", delimiter="\t")
    text.detach()


def opensim_coordinates(run: RecordedRun) -> dict[str, Array]:
    """Coordinates (F,) of Rajagopal's model by name: degrees, and metres for the position of the pelvis."""
    track, body = run.track, run.body()
    angles = PEOPLE.angles(body.model, body.held, track.up)
    columns: dict[str, Array] = {}
    for ball in angles.spherical:
        if ball.names[0] in BALLS:
            values = np.degrees(turned_zxy(angles, ball, track.pose))
            columns |= dict(zip(BALLS[ball.names[0]], values.T, strict=True))
    pelvis = (
        track.joint_positions[:, track.joint_names.index("pelvis")] @ run.from_camera(CAMERA_TO_OPENSIM).T
    )
    columns |= dict(zip(("pelvis_tx", "pelvis_ty", "pelvis_tz"), pelvis.T, strict=True))
    for d, name in enumerate(track.dof_names):
        side, _, motion = name.partition("_")
        if side in ("l", "r") and motion in HINGES:
            columns[f"{HINGES[motion]}_{side}"] = np.degrees(np.unwrap(track.pose[:, d]))
    return columns


def turned_zxy(angles: Angles, ball: SphericalJoint, poses: Array) -> Array:
    """Rotations (F, 3) of a joint about Z, X and Y, radians; for left joints those of the mirror image."""
    rotations = Rotation.from_quat(angles.turned((ball,), poses)[:, 0])
    if not ball.upward:
        rotations = Rotation.from_rotvec(rotations.as_rotvec() * MIRROR)
    turned = ZXY @ CAMERA_TO_OPENSIM @ rotations.as_matrix() @ CAMERA_TO_OPENSIM.T @ ZXY.T
    found = np.zeros((len(turned), 3))
    for f, rotation in enumerate(turned):  # each on the branch nearest to the frame before
        found[f] = euler_angles(rotation, found[max(0, f - 1)])
    return found


HEAD = ("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame",
        "OrigNumFrames")  # fmt: skip


def write_trc(run: RecordedRun, file: BinaryIO) -> None:
    """Write one line per frame: number from 1, time in seconds, and x, y, z of every joint."""
    names, frames, rate = run.track.joint_names, len(run.track.frame), f"{run.rate:.6g}"
    values = [rate, rate, str(frames), str(len(names)), "mm", rate, "1", str(frames)]
    axes = [f"{axis}{j}" for j in range(1, len(names) + 1) for axis in "XYZ"]
    text = io.TextIOWrapper(file, encoding="utf-8", newline="\n")
    for cells in (
        ["PathFileType", "4", "(X/Y/Z)", f"{run.name}.trc"],
        HEAD,
        values,
        ["Frame#", "Time", *(f"{name}\t\t" for name in names)],
        ["", "", *axes],
        [],
    ):
        text.write("\t".join(cells) + "\n")
    places = run.track.joint_positions @ run.from_camera(CAMERA_TO_OPENSIM).T * 1000.0
    seconds = run.seconds
    for f in range(frames):
        markers = [f"{value:.4f}" for value in places[f].ravel()]
        if run.track.unknown[f]:
            markers = [""] * (len(markers) + 1)  # OpenSim expects one more tab after an empty last column
        text.write("\t".join([str(f + 1), f"{seconds[f]:.6f}", *markers]) + "\n")
    text.detach()
