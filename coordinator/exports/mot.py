"""OpenSim's motion file: angles in degrees over time.

First the angles with their plain names, which mean what `docs/formats.md` says, and what slides in metres.
Then, for people, the coordinates of the full-body model of Rajagopal et al. (2016), so that the motion plays
on that model: rotations in the order Z, X, Y of the child in its parent, OpenSim's axes (x forward, y up, z
to the right). Those are Euler angles, so an arm's may jump where it is abducted by about 90 degrees. Lost
frames are left out.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from coordinator.bodies.angles import MIRROR, Angles, SphericalJoint, hanging, is_person, person_angles
from coordinator.bodies.swing_twist import nearest_turn
from coordinator.exports.recorded import CAMERA_TO_OPENSIM, RecordedRun
from coordinator.results.slides import read_slides

Array = NDArray[np.float64]

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
PELVIS = ("pelvis_tx", "pelvis_ty", "pelvis_tz")


def write_mot(run: RecordedRun, file: BinaryIO) -> None:
    """One line a frame: time, the angles, and OpenSim's coordinates."""
    track, kept = run.track, ~run.lost
    slides = read_slides(run.folder, track)
    columns = dict(zip(run.angle_names, np.degrees(run.angle).T, strict=True))
    columns |= dict(zip(slides.names, slides.value.T, strict=True))
    if is_person(track.dof_names):
        columns |= opensim_coordinates(run)
    text = io.TextIOWrapper(file, encoding="utf-8", newline="\n")
    text.write(f"{run.name}\nversion=1\nnRows={kept.sum()}\nnColumns={len(columns) + 1}\ninDegrees=yes\n")
    text.write(f"\n{run.remark}\nendheader\n")
    text.write("\t".join(["time", *columns]) + "\n")
    table = np.stack([track.time_s, *columns.values()], axis=1)[kept]
    np.savetxt(text, table, fmt="%.8f", delimiter="\t")
    text.detach()


def opensim_coordinates(run: RecordedRun) -> dict[str, Array]:
    """Coordinates (F,) of Rajagopal's model by name: degrees, and metres for the pelvis' place."""
    track = run.track
    angles = person_angles(track.dof_names, run.body().held, track.up)
    columns: dict[str, Array] = {}
    for ball in angles.balls:
        if ball.names[0] in BALLS:
            values = np.degrees(turned_zxy(angles, ball, track.pose))
            columns |= dict(zip(BALLS[ball.names[0]], values.T, strict=True))
    pelvis = track.joint_positions[:, track.joint_names.index("pelvis")] @ run.to_opensim.T
    columns |= dict(zip(PELVIS, pelvis.T, strict=True))
    return columns | dict(hinge_coordinates(track.dof_names, track.pose))


def hinge_coordinates(dof_names: tuple[str, ...], poses: Array) -> Iterator[tuple[str, Array]]:
    """The same of joints of one degree of freedom."""
    for d, name in enumerate(dof_names):
        side, _, motion = name.partition("_")
        if side in ("l", "r") and motion in HINGES:
            yield f"{HINGES[motion]}_{side}", np.degrees(np.unwrap(poses[:, d]))


def turned_zxy(angles: Angles, ball: SphericalJoint, poses: Array) -> Array:
    """Rotations (F, 3) about Z, X and Y of a joint, of a left one those of its mirror image; radians."""
    rotations = angles.rotation(ball, poses) * Rotation.from_rotvec(hanging(ball))
    if not ball.upward:
        rotations = Rotation.from_rotvec(rotations.as_rotvec() * MIRROR)
    turned = CAMERA_TO_OPENSIM @ rotations.as_matrix() @ CAMERA_TO_OPENSIM.T
    return without_leaps(Rotation.from_matrix(turned).as_euler("ZXY", suppress_warnings=True))


def without_leaps(euler: Array) -> Array:
    """The same rotations (F, 3), each on the branch nearest to the frame before."""
    chosen = euler.copy()
    for f in range(1, len(chosen)):
        other = euler[f] * [1.0, -1.0, 1.0] + np.pi
        branches = [nearest_turn(branch, chosen[f - 1]) for branch in (euler[f], other)]
        chosen[f] = min(branches, key=lambda branch: float(np.sum((branch - chosen[f - 1]) ** 2)))
    return chosen
