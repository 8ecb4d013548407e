"""A person before a high camera that is pitched down and rolled is detected and tracked."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from common.camera import back_project
from common.kinematics import joint_positions, pose_vertices
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.rendering import DepthRenderer
from gepf.direct import DirectRefiner
from tests.support.people import CAMERA, RAISING, SETTINGS, STANDING, OnePerson, Shown, frame_of, known
from tests.support.rooms import along

PITCH = np.radians(30.0)  # down
WALL = 4.2  # metres from the camera, along the floor
ABOVE = 0.8  # metres, of the camera over the middle of the person
FRAMES = 3


@pytest.mark.parametrize("roll_deg", [0.0, 15.0])
def test_a_camera_that_looks_down(roll_deg: float) -> None:
    """The person is found in the first frame, and followed; nothing is taken for upright that is not."""
    frames, joints = looked_down_on(np.radians(roll_deg))
    tracker = OnePerson(DirectRefiner(), SETTINGS, known())
    for frame, truth in zip(frames, joints, strict=True):
        estimate = tracker.track(frame)
        assert estimate.status in ("tracked", "ambiguous")
        assert np.linalg.norm(estimate.joint_positions - truth, axis=-1).mean() < 0.05


def looked_down_on(roll: float) -> Shown:
    """A person who raises the left arm, a floor and a wall, as such a camera sees them."""
    model, turn = human(1.82), Rotation.from_euler("xz", [PITCH, roll]).as_matrix()
    moving = [{name: rate * n for name, rate in RAISING.items()} for n in range(FRAMES)]
    poses = np.array([name_pose(model, {**STANDING, **more, "root_ty": ABOVE}) for more in moving])
    vertices, joints = pose_vertices(model, poses), joint_positions(model, poses)
    floor = float(vertices[0, :, 1].max()) + 0.005
    with DepthRenderer(CAMERA) as renderer:
        pictures = [renderer.depth(each @ turn.T, model.triangles) for each in vertices]
    level = back_project(np.ones((CAMERA.height, CAMERA.width)), CAMERA) @ turn
    room = np.minimum(along(floor, level[..., 1]), along(WALL, level[..., 2]))
    room[room > 8.0] = 0.0
    frames = [frame_of(n, np.where(each > 0.0, each, room)) for n, each in enumerate(pictures)]
    return Shown(frames, joints @ turn.T)
