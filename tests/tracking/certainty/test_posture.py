"""How a person is held as a whole: folded at the hips, joints before or behind the pelvis."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from common.activation import activate
from common.body import BodyModel
from common.kinematics import joint_positions
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.bodies.tracked import name_pose
from coordinator.tracking.certainty.posture import posture_of
from tests.support.bodies import hinges
from tests.support.people import SITTING, STANDING

Array = NDArray[np.float64]

LEGS = ("hip", "knee", "ankle")


@cache
def body(legs: bool = True) -> BodyModel:
    """A person with the usual degrees of freedom, or one whose legs are held as somebody sits."""
    whole = human(1.75)
    moving = [name for name in DEFAULT_ACTIVE if legs or not any(part in name for part in LEGS)]
    return activate(whole, tuple(moving), name_pose(whole, {} if legs else SITTING))


def joints_of(values: dict[str, float], legs: bool = True) -> Array:
    """Joints (J, 3) of a pose by name."""
    model = body(legs)
    named = {name: value for name, value in values.items() if name in model.dof_names}
    joints: Array = joint_positions(model, name_pose(model, named)[None])[0]
    return joints


def test_who_stands_is_not_folded() -> None:
    """Trunk and thighs in one line, all within a span of the pelvis' depth."""
    posture = posture_of(body(), joints_of(STANDING))
    assert posture.folded < 0.05
    assert posture.ahead.max() < 0.3


@pytest.mark.parametrize("angle", [0.5, 1.0, 1.5, 2.0])
def test_the_angle_is_that_of_the_hips(angle: float) -> None:
    """Both hips flexed by an angle fold by its square, however the body is turned."""
    hips = {f"{side}_hip_flexion": angle for side in "rl"}
    for turn in (0.0, 1.4):
        posture = posture_of(body(), joints_of({**hips, "root_ry": turn, "root_tz": 2.5}))
        assert np.sqrt(posture.folded) == pytest.approx(angle, abs=0.1)


def test_joints_before_and_behind_the_pelvis_are_told() -> None:
    """A hand held out to the camera and one held out behind are as far from the pelvis' depth as they are."""
    joints = joints_of({"root_tz": 2.5, "r_shoulder_flexion": 1.5, "l_shoulder_flexion": -0.8})
    names = body().joint_names
    ahead = posture_of(body(), joints).ahead
    assert ahead[names.index("pelvis")] == 0.0
    for side, sign in (("right", -1.0), ("left", 1.0)):
        wrist = names.index(f"{side}_wrist")
        assert ahead[wrist] == pytest.approx(sign * (joints[wrist, 2] - joints[names.index("pelvis"), 2]))
        assert ahead[wrist] > 0.2


def test_a_body_without_them_and_one_whose_legs_are_held_have_no_posture() -> None:
    """Nothing moves their thighs, or they have none: all is zero."""
    seated = joints_of(STANDING, legs=False)
    for model, joints in ((hinges(), np.ones((len(hinges().joint_names), 3))), (body(legs=False), seated)):
        posture = posture_of(model, joints)
        assert posture.folded == 0.0
        np.testing.assert_array_equal(posture.ahead, np.zeros(len(joints)))
