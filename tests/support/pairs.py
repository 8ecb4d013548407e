"""Two people side by side in a room, rendered."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array
from gepf.common.kinematics import joint_positions
from gepf.coordinator.bodies.human.template import human
from gepf.coordinator.bodies.tracked import name_pose
from tests.support.people import CAMERA, STANDING, Shown, frame_of, raised, rendered
from tests.support.recordings import write_open3d
from tests.support.rooms import in_a_room

FRAMES = 6
LEFT: Mapping[str, float] = {**STANDING, "root_tx": -0.5}
RIGHT: Mapping[str, float] = {**STANDING, "root_tx": 0.5, "root_tz": 2.9, "root_ry": 0.3}
STATURES = (1.82, 1.7)


@cache
def pair(apart: float = 1.0) -> tuple[Shown, Shown]:
    """Two people who raise the left arm: the same frames of a room, and the joints of each.

    apart: distance between them, metres.
    """
    models = [human(stature) for stature in STATURES]
    pictures, joints = [np.zeros((CAMERA.height, CAMERA.width))] * FRAMES, []
    for model, posture in zip(models, (LEFT, RIGHT), strict=True):
        placed = {**posture, "root_tx": apart * posture["root_tx"]}
        poses = np.array([name_pose(model, raised(placed, n)) for n in range(FRAMES)])
        joints.append(joint_positions(model, poses))
        pictures = [nearer(*each) for each in zip(pictures, rendered(model, poses), strict=True)]
    frames = [in_a_room(frame_of(n, picture)) for n, picture in enumerate(pictures)]
    return Shown(frames, joints[0]), Shown(frames, joints[1])


def nearer(one: NDArray[np.floating], other: NDArray[np.floating]) -> Array:
    """Of two depth images the nearer in each pixel, where 0 is nothing."""
    least = np.minimum(np.where(one > 0, one, np.inf), np.where(other > 0, other, np.inf))
    return np.where(np.isfinite(least), least, 0.0)


def write_pair(folder: Path, frames: int = FRAMES) -> Path:
    """The two as a sequence; its truth is the first one's."""
    shown, _ = pair()
    write_open3d(folder, np.array([frame.views[0].depth for frame in shown.frames[:frames]]), CAMERA)
    names = np.array(human(STATURES[0]).joint_names)
    np.savez(folder / "truth.npz", joint_names=names, joint_positions=shown.joints[:frames])
    return folder
