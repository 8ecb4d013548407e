"""`gepf track` with a slowly moving camera, and with a person partly outside the image."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import gepf
from common.kinematics import joint_positions, pose_vertices
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import name_pose
from coordinator.cli import main
from coordinator.synthesis.rendering import DepthRenderer
from tests.support.pairs import raised
from tests.support.people import CAMERA, STANDING
from tests.support.rooms import along
from tests.support.stand_ins import Direct

Array = NDArray[np.float64]

FRAMES, RATE = 12, 10.0
FLOOR, WALL = 1.15, 4.0  # metres below and before the camera
TURN, MOVE = np.radians(2.0) / RATE, 0.05 / RATE  # a frame
OPTIONS = ("--particles", "6", "--points", "1500", "--no-pictures")


@cache
def film(turn: float, move: float) -> tuple[Array, Array]:
    """Depth (F, H, W) of a person in a room whose camera turns and moves, and joints (F, J, 3), metres."""
    model = human(1.82)
    poses = np.array([name_pose(model, raised(STANDING, n)) for n in range(FRAMES)])
    surfaces, joints, pictures = pose_vertices(model, poses), joint_positions(model, poses), []
    v, u = np.indices((CAMERA.height, CAMERA.width))
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)
    with DepthRenderer(CAMERA) as renderer:
        for n in range(FRAMES):
            c, s, place = np.cos(turn * n), np.sin(turn * n), np.array([move * n, 0.0, 0.0])
            ahead = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])  # turns to the room's axes
            around = rays @ ahead.T
            room = np.minimum(along(FLOOR, around[..., 1]), along(WALL, around[..., 2]))
            person = renderer.depth((surfaces[n] - place) @ ahead, model.triangles)
            pictures.append(np.where(person > 0.0, person, room))
            joints[n] = (joints[n] - place) @ ahead
    return np.array(pictures), joints


def write(folder: Path, depth: Array, top: int = 0, bottom: int = CAMERA.height) -> Path:
    """Some rows of a film as a sequence."""
    (folder / "depth").mkdir(parents=True)
    for n, picture in enumerate(depth):
        units = np.rint(1000.0 * picture[top:bottom]).astype(np.uint16)
        Image.fromarray(units).save(folder / "depth" / f"{n:06d}.png")
    matrix = [CAMERA.fx, 0, 0, 0, CAMERA.fy, 0, CAMERA.cx, CAMERA.cy - top, 1]
    camera = {"width": CAMERA.width, "height": bottom - top, "depth_scale": 1000, "fps": RATE}
    (folder / "camera_intrinsic.json").write_text(json.dumps({**camera, "intrinsic_matrix": matrix}))
    return folder


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
