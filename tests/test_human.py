"""The human template: closed symmetric surface, all of MPEG-4's angles, signs, proportions."""

from __future__ import annotations

import numpy as np
import pytest

from common.body import BodyModel
from common.kinematics import joint_positions
from coordinator.models.human import DEFAULT_ACTIVE, human
from coordinator.models.mpeg4 import BODY_ANIMATION_PARAMETERS


@pytest.fixture(scope="module")
def model() -> BodyModel:
    return human(1.75)


def joints_at(model: BodyModel, **angles: float) -> dict[str, np.ndarray]:
    """Named joints (3,) with these angles in radians, all others zero."""
    pose = np.zeros(len(model.dof_names))
    for name, angle in angles.items():
        pose[model.dof(name)] = angle
    return dict(zip(model.joint_names, joint_positions(model, pose[None])[0], strict=True))


def test_every_parameter_of_mpeg4_is_a_degree_of_freedom_that_may_rest_at_zero(model: BodyModel) -> None:
    """All 186 parameters can be addressed, and zero lies within the limits of each."""
    assert set(model.dof_names) == set(BODY_ANIMATION_PARAMETERS.values())
    assert len(model.dof_names) == 186
    assert set(DEFAULT_ACTIVE) <= set(model.dof_names) and len(DEFAULT_ACTIVE) == 24
    assert np.all(model.limits[:, 0] <= 0) and np.all(model.limits[:, 1] >= 0)
