"""Angles from joint positions are those of the body's pose."""

from __future__ import annotations

import numpy as np
import pytest

from common.kinematics import joint_positions
from coordinator.bodies.angles import angles_of
from coordinator.bodies.from_joints import angles_from_joints
from coordinator.bodies.human.template import human
from coordinator.bodies.tracked import name_pose

NAMES = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
STANDING = {
    f"{side}_{name}": [out * (0.2 if name in NAMES[:3] else 0.1), down, 2.0]
    for side, out in (("right", -1.0), ("left", 1.0))
    for name, down in zip(NAMES, (-0.4, -0.1, 0.15, 0.1, 0.5, 0.9), strict=True)
}


def test_hanging_arms_have_no_angles() -> None:
    """Limbs straight down along the trunk, for any turn of the person; all names exist."""
    turn = np.array([[0.0, 0.6, 0.8], [0.0, -0.8, 0.6], [1.0, 0.0, 0.0]])
    found = angles_from_joints(tuple(STANDING), np.array([list(STANDING.values())]) @ turn.T)
    assert len(found) == 12
    assert np.abs(list(found.values())).max() < 1e-6


def test_joints_of_a_body_give_the_angles_of_its_pose() -> None:
    """Elbows and knees to the degree; shoulders and hips, whose upright is another, within ten."""
    model = human(1.8)
    bent = {f"{side}_{joint}_flexion": 0.9 for side in "rl" for joint in ("elbow", "hip", "knee")}
    raised = {"r_shoulder_flexion": 0.7, "l_shoulder_abduct": 0.5, "root_tz": 2.5, "root_ry": 0.4}
    pose = name_pose(model, bent | raised)[None]
    angles = angles_of(model, {})
    known = dict(zip(angles.names, np.degrees(angles.measure(pose)[0]), strict=True))
    found = angles_from_joints(model.joint_names, joint_positions(model, pose))
    assert len(found) == 12
    for name, values in found.items():
        near = 1.0 if "elbow" in name or "knee" in name else 10.0
        assert np.degrees(values[0]) == pytest.approx(known[name], abs=near), name


def test_what_is_not_known_is_left_out() -> None:
    """Angles of joints without a name; NaN where a joint is, or where two coincide."""
    names = ("right_shoulder", "right_elbow", "right_wrist")
    joints = np.array([[STANDING[name] for name in names]] * 3)
    joints[0, 2], joints[1, 2] = np.nan, joints[1, 1]
    found = angles_from_joints(names, joints)
    assert list(found) == ["right_elbow_flexion"]
    assert np.isnan(found["right_elbow_flexion"]).tolist() == [True, True, False]
