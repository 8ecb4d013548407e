"""A limb hidden by the body is reported as uncertain, and found as soon as it is visible again."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.activation import activate
from common.body import BodyModel
from common.frame import DepthFrame
from common.kinematics import joint_positions, pose_vertices
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.bodies.tracked import name_pose
from coordinator.synthesis.rendering import DepthRenderer
from tests.support.people import CAMERA, SETTINGS, STANDING, frame_of, tracker

Array = NDArray[np.float64]

BACK = {**STANDING, "root_ry": np.pi}
FOLDED = {**BACK, "r_shoulder_abduct": -0.1, "r_shoulder_flexion": 0.6, "r_elbow_flexion": 2.4}
"""Seen from behind, the right forearm before the chest."""

HELD_UP = {
    **BACK, "r_shoulder_abduct": 0.0, "r_shoulder_flexion": 1.4, "r_shoulder_twisting": 0.6,
    "r_elbow_flexion": 0.6,
}  # fmt: skip
MANY = msgspec.structs.replace(SETTINGS, filter=msgspec.structs.replace(SETTINGS.filter, particles=20))


@cache
def body() -> BodyModel:
    """The person who is shown, with the joints that are tracked."""
    whole = human(1.82)
    return activate(whole, DEFAULT_ACTIVE, np.zeros(len(whole.dof_names)))


def frames_of(*poses: dict[str, float]) -> list[DepthFrame]:
    """Frames of the person in these poses."""
    vertices = pose_vertices(body(), np.array([name_pose(body(), pose) for pose in poses]))
    with DepthRenderer(CAMERA) as renderer:
        return [frame_of(n, renderer.depth(v, body().triangles)) for n, v in enumerate(vertices)]


def test_a_hidden_arm_is_not_said_to_be_known() -> None:
    """A hidden arm may be anywhere behind the body. It is found when it is visible again."""
    out = {**BACK, "r_shoulder_abduct": 1.0, "r_elbow_flexion": 0.5}
    frames = frames_of(*[FOLDED] * 8, out, out, out)
    follower = tracker(MANY, FOLDED)
    estimates = [follower.track(frame) for frame in frames]
    wrist = follower.model.joint_names.index("right_wrist")
    for estimate in estimates[3:8]:
        assert estimate.certainty is not None
        assert estimate.certainty.off_probability[wrist] > 0.06
    places = joint_positions(body(), name_pose(body(), out)[None])[0]
    found = estimates[-1].joint_positions[wrist]
    assert np.linalg.norm(found - places[body().joint_names.index("right_wrist")]) < 0.1


def test_a_hidden_arm_does_not_fall_to_rest() -> None:
    """A forearm held up before the chest, seen from behind with noise: it does not move in any frame."""
    picture, rng = frames_of(HELD_UP)[0].depth / 1000.0, np.random.default_rng(0)
    noise = 0.01 * rng.standard_normal((15, *picture.shape))
    shown = [frame_of(n, np.where(picture > 0.0, picture + off, 0.0)) for n, off in enumerate(noise)]
    follower = tracker(MANY, HELD_UP)
    estimates = [follower.track(frame) for frame in shown]
    true = joint_positions(body(), name_pose(body(), HELD_UP)[None])[0]
    wrist = follower.model.joint_names.index("right_wrist")
    off = [np.linalg.norm(e.joint_positions[wrist] - true[wrist]) for e in estimates]
    assert max(off) < 0.05
