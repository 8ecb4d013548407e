"""`gepf track` with a slowly moving camera, and with a person partly outside the image."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gepf
from gepf.common.arrays import Array
from gepf.common.camera import back_project, inverse, moved
from gepf.common.kinematics import joint_positions
from gepf.common.kinematics.rotations import euler_matrix
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from gepf.coordinator.cli import main
from tests.support.people import CAMERA, STANDING, raised, rendered
from tests.support.recordings import write_open3d
from tests.support.rooms import along
from tests.support.stand_ins import Direct

FRAMES, RATE = 12, 10.0
FLOOR, WALL = 1.15, 4.0  # metres below and before the camera
TURN, MOVE = np.radians(2.0) / RATE, 0.05 / RATE  # a frame
OPTIONS = ("--particles", "6", "--points", "1500", "--no-pictures")


@cache
def film(turn: float, move: float) -> tuple[Array, Array]:
    """Depth (F, H, W) of a person in a room whose camera turns and moves, and joints (F, J, 3), metres."""
    model = human(1.82)
    poses = np.array([name_pose(model, raised(STANDING, n)) for n in range(FRAMES)])
    joints, pictures = joint_positions(model, poses), []
    rays = back_project(np.ones((CAMERA.height, CAMERA.width)), CAMERA)
    for n, pose in enumerate(poses):
        placed = np.eye(4)
        placed[:3, :3] = euler_matrix(np.array([0.0, turn * n, 0.0]))
        placed[0, 3] = move * n
        around = rays @ placed[:3, :3].T
        room = np.minimum(along(FLOOR, around[..., 1]), along(WALL, around[..., 2]))
        (person,) = rendered(model, pose[None], placed=placed)
        pictures.append(np.where(person > 0.0, person, room))
        joints[n] = moved(joints[n], inverse(placed))
    return np.array(pictures), joints


def write(folder: Path, depth: Array, top: int = 0, bottom: int = CAMERA.height) -> Path:
    """Some rows of a film as a sequence."""
    units = np.rint(1000.0 * depth[:, top:bottom]).astype(np.uint16)
    return write_open3d(folder, units, CAMERA.crop(0, top, CAMERA.width, bottom - top), RATE)


def track(sequence: Path, out: Path) -> gepf.Run:
    """A run that ends well."""
    assert main(["track", str(sequence), "--out", str(out), *OPTIONS], Direct().connect) == 0
    return gepf.load(out)


def test_a_camera_that_turns_slowly_keeps_the_person(tmp_path: Path) -> None:
    """Two degrees and five centimetres a second: within 4 cm in every frame, none lost."""
    depth, joints = film(TURN, MOVE)
    run = track(write(tmp_path / "turning", depth), tmp_path / "run")
    assert set(run.track.status) <= {"tracked", "ambiguous"}
    assert np.linalg.norm(run.track.joint_positions - joints, axis=-1).mean(axis=1).max() < 0.04


@pytest.mark.parametrize(("top", "bottom"), [(0, 180), (60, CAMERA.height)])
def test_who_is_cropped_is_found(tmp_path: Path, top: int, bottom: int) -> None:
    """Without feet or head: visible joints are right after a few frames, and in every `tracked` frame.

    Other joints are not reported as visible.
    """
    depth, joints = film(0.0, 0.0)
    run = track(write(tmp_path / "cropped", depth, top, bottom), tmp_path / "run")
    off = np.linalg.norm(run.track.joint_positions - joints, axis=-1)
    row = CAMERA.cy + CAMERA.fy * joints[..., 1] / joints[..., 2]
    inside = (row >= top) & (row < bottom)
    right = np.array([o[i].mean() < 0.08 for o, i in zip(off, inside, strict=True)])
    assert right[run.track.status == "tracked"].all()
    assert right[len(right) // 2 :].all()
    seen = run.track.joint_seen
    assert seen[~inside].mean() < 0.5 * seen[inside].mean()
