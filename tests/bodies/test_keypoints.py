"""Keypoints on the body: where they are, for people of any shape and with any degrees of freedom."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.activation import activate
from gepf.common.body import KEYPOINTS, with_fixed_shape
from gepf.common.kinematics import keypoint_positions
from gepf.common.protocol.models import decode_model, encode_model
from gepf.coordinator.bodies.human.shape_space import Size, shape_space
from gepf.coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from gepf.coordinator.bodies.tracked import coarsen

NEAR_JOINT_M = 0.1  # clicked points are this near to the joints of their names
LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


@pytest.mark.parametrize("stature", [1.1, 1.5, 1.75, 1.95])
def test_they_are_near_their_joints_and_symmetric(stature: float) -> None:
    """Of children and adults: within 10 cm of an adult's joints; left and right are mirror images."""
    model = human(stature)
    at = dict(zip(KEYPOINTS, model.keypoint_points, strict=True))
    for limb in LIMBS:
        joint = model.joint_points[model.joint_names.index(f"left_{limb}")]
        assert np.linalg.norm(at[f"left_{limb}"] - joint) < NEAR_JOINT_M * stature / 1.75
    for part in ("eye", "ear", *LIMBS):
        np.testing.assert_allclose(at[f"right_{part}"], at[f"left_{part}"] * (-1.0, 1.0, 1.0), atol=0.004)
    assert at["nose"][2] < at["left_eye"][2] < at["left_ear"][2]  # the front is -z


def test_shape_coefficients_move_them_as_another_person() -> None:
    """A body of any shape, fixed at a child's, has the keypoints of the child."""
    space = shape_space()
    child = space.person(1.2, 1.1)
    fixed = with_fixed_shape(space.anybody, space.coefficients(Size(1.2, 1.1)))
    np.testing.assert_allclose(fixed.keypoint_points, child.keypoint_points, atol=1e-9)
    pose = np.zeros(len(space.anybody.dof_names))
    pose[: len(space.coefficients(Size(1.2, 1.1)))] = space.coefficients(Size(1.2, 1.1))
    posed = keypoint_positions(space.anybody, pose[None])[0]
    np.testing.assert_allclose(posed, child.keypoint_points, atol=1e-9)


def test_a_coarse_body_has_them_at_the_same_places() -> None:
    """With a tenth of the vertices, in which detection searches."""
    model = activate(human(), DEFAULT_ACTIVE, np.zeros(len(human().dof_names)))
    coarse = coarsen(model, 0.1)
    assert len(coarse.vertices) < 0.3 * len(model.vertices)
    np.testing.assert_allclose(coarse.keypoint_points, model.keypoint_points, atol=1e-9)


def test_a_subset_of_the_degrees_of_freedom_keeps_them() -> None:
    """They stay where they were in the same pose, and go over the wire."""
    whole = human()
    pose = np.zeros(len(whole.dof_names))
    pose[whole.dof("l_shoulder_abduct")], pose[whole.dof("root_tz")] = 1.0, 3.0
    part = activate(whole, DEFAULT_ACTIVE, np.zeros(len(pose)))
    same = np.array([pose[whole.dof(name)] for name in part.dof_names])
    places = []
    for model, angles in ((whole, pose), (decode_model(encode_model(part)), same)):
        places.append(keypoint_positions(model, angles[None])[0])
    np.testing.assert_allclose(places[1], places[0], atol=1e-9)
