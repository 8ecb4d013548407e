"""The prior of arms: what it prefers, that both sides are alike, and to whom it applies."""

from __future__ import annotations

import numpy as np
import pytest

from gepf.common.activation import activate
from gepf.coordinator.bodies.human.people import PEOPLE
from gepf.coordinator.bodies.human.typical_poses import people_poses
from gepf.coordinator.bodies.mechanisms import MECHANISMS
from gepf.coordinator.settings import preset
from gepf.coordinator.tracking.observation import isolate
from gepf.coordinator.tracking.target import depth_log_likelihood_of
from tests.support.bodies import person, puppet
from tests.support.people import STANDING, known, shown

REFINE = preset("default").refine
OTHER = {"l_": "r_", "r_": "l_"}
ARMS = ("shoulder", "elbow_flexion")


def test_recorded_arms_are_likelier_than_arms_anywhere_within_the_limits() -> None:
    """The worst tenth of the recorded arms is likelier than half of those drawn within the limits."""
    model, rng = person(), np.random.default_rng(0)
    recorded = people_poses(model)
    dofs = [n for n, name in enumerate(model.dof_names) if name.partition("_")[2].startswith(ARMS)]
    drawn = recorded.copy()
    drawn[:, dofs] = rng.uniform(model.limits[dofs, 0], model.limits[dofs, 1], size=(len(drawn), len(dofs)))
    likely, anywhere = (PEOPLE.log_pose_prior(model, REFINE, poses) for poses in (recorded, drawn))
    assert np.quantile(likely, 0.1) > np.median(anywhere)


def test_an_arm_through_the_chest_is_less_likely_than_one_beside_it() -> None:
    """The case that it decides: the elbow of one arm behind the other shoulder, or at its own side."""
    model = person()
    poses = np.zeros((2, len(model.dof_names)))
    poses[:, model.dof("l_elbow_flexion")] = np.radians(40.0)
    poses[1, model.dof("l_shoulder_abduct")] = np.radians(-50.0)
    poses[1, model.dof("l_shoulder_twisting")] = np.radians(80.0)
    beside, through = PEOPLE.log_pose_prior(model, REFINE, poses)
    assert beside > through + 1.0


def test_left_and_right_are_alike() -> None:
    """A pose and its mirror image are as likely, and neither legs nor the place of the body matter."""
    model, rng = person(), np.random.default_rng(1)
    poses = np.clip(rng.normal(0.0, 0.6, (20, len(model.dof_names))), *model.limits.T)
    names = list(model.dof_names)
    other_side = [names.index(OTHER[n[:2]] + n[2:]) if n[:2] in OTHER else k for k, n in enumerate(names)]
    mirrored = poses[:, other_side]
    moved = poses + np.where(["hip" in n or "knee" in n or n.startswith("root") for n in names], 0.2, 0.0)
    before = PEOPLE.log_pose_prior(model, REFINE, poses)
    np.testing.assert_allclose(PEOPLE.log_pose_prior(model, REFINE, mirrored), before, rtol=1e-6)
    np.testing.assert_allclose(PEOPLE.log_pose_prior(model, REFINE, moved), before, rtol=1e-6)


def test_it_applies_to_people_by_the_default_preset() -> None:
    """Bodies of other families, the preset as published, and an arm that is held in part have none."""
    model = person()
    poses = np.full((3, len(model.dof_names)), 0.3)
    assert PEOPLE.log_pose_prior(model, REFINE, poses).all()
    assert not PEOPLE.log_pose_prior(model, preset("paper").refine, poses).any()
    puppets = puppet()
    one_arm = activate(
        person(), [n for n in model.dof_names if n != "r_shoulder_flexion"], np.zeros(len(model.dof_names))
    )
    likely = PEOPLE.log_pose_prior(one_arm, REFINE, np.zeros((1, len(one_arm.dof_names))))
    np.testing.assert_allclose(2.0 * likely, PEOPLE.log_pose_prior(model, REFINE, np.zeros_like(poses[:1])))
    assert not MECHANISMS.log_pose_prior(puppets, REFINE, np.ones((3, len(puppets.dof_names)))).any()


def test_gates_do_not_see_it() -> None:
    """The likelihood by depth is that of the refinement, whatever the prior adds to a hypothesis."""
    model, pose = known().tracked(known().usual_size, STANDING)
    subject = isolate(shown("standing").frames[0], 500)
    assert subject is not None
    prior = PEOPLE.log_pose_prior(model, REFINE, pose[None])[0]
    assert prior < 0.0
    assert depth_log_likelihood_of(-3.0 + prior, PEOPLE, model, pose, subject, REFINE) == pytest.approx(-3.0)
