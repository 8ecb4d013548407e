"""A person who moves far between two frames is searched for in the same frame."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from common.kinematics import joint_positions
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import name_pose
from gepf.direct import DirectRefiner
from tests.support.people import CAMERA, SETTINGS, STANDING, OnePerson, Shown, frame_of, known, rendered
from tests.support.rooms import along

WALL = 4.2  # metres away
STARTS = {"arms hang": STANDING, "elbows bent": {**STANDING, "l_elbow_flexion": 1.2, "r_elbow_flexion": 1.2}}
STEPS = ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.3, 0.45), (0.3, 0.45))  # metres aside and away


@cache
def stepping(posture: str) -> Shown:
    """A person in a room who stands still, and in the fourth frame stands elsewhere."""
    model, start = human(1.82), STARTS[posture]
    places = [(start["root_tx"] + x, start["root_tz"] + z) for x, z in STEPS]
    poses = np.array([name_pose(model, {**start, "root_tx": x, "root_tz": z}) for x, z in places])
    pictures = rendered(model, poses)
    down = np.broadcast_to(((np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.fy)[:, None], pictures[0].shape)
    room = np.minimum(along(max(float((down * each).max()) for each in pictures) + 0.01, down), WALL)
    frames = [frame_of(n, np.where(each > 0.0, each, room)) for n, each in enumerate(pictures)]
    return Shown(frames, joint_positions(model, poses))


@pytest.mark.parametrize("posture", STARTS)
def test_who_steps_far_is_found_in_that_frame(posture: str) -> None:
    """Found in that frame, though some points are near the former place; and in the next frame."""
    frames, joints = stepping(posture)
    followed = OnePerson(DirectRefiner(), SETTINGS, known(), STARTS[posture])
    for frame, truth in zip(frames, joints, strict=True):
        estimate = followed.track(frame)
        assert estimate.status in ("tracked", "ambiguous")
        assert np.linalg.norm(estimate.joint_positions - truth, axis=-1).mean() < 0.05
