"""The head of a person who looks down."""

from __future__ import annotations

import numpy as np
import pytest

from coordinator.bodies.choice import USUAL, choose_bodies
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import name_pose
from gepf.direct import DirectRefiner
from tests.support.people import SETTINGS, STANDING, OnePerson, show

DOWN = 0.7  # radians by which the neck is bent in the end


@pytest.mark.parametrize("turned", [0.0, np.pi])
def test_a_head_goes_down_with_the_neck(turned: float) -> None:
    """Within 4 cm, from the front and from behind; without the neck's joint more."""
    model = human(1.75)
    bends = np.append(np.linspace(0.0, DOWN, 6), np.full(3, DOWN))
    poses = np.array([name_pose(model, {**STANDING, "root_ry": turned, "vc7_tilt": bend}) for bend in bends])
    frames, joints = show(model, poses)
    truth = joints[-1, model.joint_names.index("head")]
    neckless = tuple(name for name in USUAL["default"] if name != "vc7_tilt")
    following, stiff = (
        OnePerson(DirectRefiner(), SETTINGS, choose_bodies(names, "default")) for names in (None, neckless)
    )
    bent, straight = [[one.track(frame) for frame in frames][-1] for one in (following, stiff)]
    head = following.model.joint_names.index("head")
    assert np.linalg.norm(bent.joint_positions[head] - truth) < 0.04
    assert 0.5 * DOWN < bent.pose[following.model.dof("vc7_tilt")] < 1.2 * DOWN
    assert np.linalg.norm(straight.joint_positions[head] - truth) > 0.04
