"""Who stands before a camera that hangs high, looks down and is rolled, is found and followed."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from common.frame import DepthFrame
from common.kinematics import joint_positions, pose_vertices
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.rendering import DepthRenderer
from gepf.direct import DirectRefiner
from tests.support.people import CAMERA, RAISING, SETTINGS, STANDING, OnePerson, Shown, frame_of, known
from tests.support.rooms import along

Array = NDArray[np.float64]

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
        assert estimate.status == "tracked"
        assert np.linalg.norm(estimate.joint_positions - truth, axis=-1).mean() < 0.05


def looked_down_on(roll: float) -> Shown:
    """A person who raises the left arm, a floor and a wall, as such a camera sees them."""
    model, turn = human(1.82), from_level(roll)
    moving = [{name: rate * n for name, rate in RAISING.items()} for n in range(FRAMES)]
    poses = np.array([name_pose(model, {**STANDING, **more, "root_ty": ABOVE}) for more in moving])
    vertices, joints = pose_vertices(model, poses), joint_positions(model, poses)
    floor = float(vertices[0, :, 1].max()) + 0.005
    with DepthRenderer(CAMERA) as renderer:
        pictures = [renderer.depth(each @ turn.T, model.triangles) for each in vertices]
    level = rays() @ turn
    room = np.minimum(along(floor, level[..., 1]), along(WALL, level[..., 2]))
    return Shown([in_room(n, each, room) for n, each in enumerate(pictures)], joints @ turn.T)


def from_level(roll: float) -> Array:
    """Rotation (3, 3) from a level camera's frame to that of one that looks down by PITCH and is rolled."""
    c, s = np.cos(PITCH), np.sin(PITCH)
    down = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    a, b = np.cos(roll), np.sin(roll)
    turned: Array = np.array([[a, -b, 0.0], [b, a, 0.0], [0.0, 0.0, 1.0]]) @ down
    return turned


def rays() -> Array:
    """The camera's rays (H, W, 3), one metre deep."""
    v, u = np.indices((CAMERA.height, CAMERA.width))
    return np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)], axis=-1)


def in_room(number: int, person: NDArray[np.float32], room: Array) -> DepthFrame:
    """A picture of a person before what is behind."""
    return frame_of(number, np.where(person > 0.0, person, np.where(room < 8.0, room, 0.0)))
