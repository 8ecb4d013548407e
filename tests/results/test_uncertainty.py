"""How sure the tracker is, from its hypotheses."""

from __future__ import annotations

import numpy as np
import pytest

from common.activation import activate
from common.kinematics import joint_positions
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.results.recorded import assemble
from coordinator.results.uncertainty import ANGLE_MISFIT, MISFIT, UNSEEN, joint_deviation
from coordinator.tracking.estimate import Estimate, Status


def test_agreement_leaves_the_misfit() -> None:
    """Hypotheses in one place: as sure as the template fits."""
    joints = np.ones((4, 3, 3))
    assert joint_deviation(joints, joints[0], np.ones(4)) == pytest.approx([MISFIT] * 3)


def test_a_likely_rival_counts_by_its_weight() -> None:
    """A joint 20 cm away at a quarter of the weight is a spread of 10 cm; scaled weights are the same."""
    joints = np.zeros((2, 1, 3))
    joints[1, 0, 2] = 0.2
    expected = [np.hypot(MISFIT, UNSEEN * 0.1)]
    assert joint_deviation(joints, joints[0], np.array([0.75, 0.25])) == pytest.approx(expected)
    assert joint_deviation(joints, joints[0], np.array([7.5, 2.5])) == pytest.approx(expected)


def test_a_track_says_how_sure_it_is_unless_lost() -> None:
    """An elbow that may be bent or not leaves wrist unsure and hips sure; a lost frame says nothing."""
    whole = human()
    model = activate(whole, DEFAULT_ACTIVE, np.zeros(len(whole.dof_names)))
    straight = np.zeros(len(model.dof_names))
    bent = straight.copy()
    bent[model.dof("r_elbow_flexion")] = 1.5

    def estimate(status: Status) -> Estimate:
        poses, weights = np.stack([straight, bent]), np.array([0.5, 0.5])
        joints = joint_positions(model, straight[None])[0]
        return Estimate(0, 0.0, status, straight, joints, poses, weights, 0.01)

    track = assemble(model, [estimate("tracked"), estimate("lost")])
    assert track.joint_deviation is not None
    apart = dict(zip(track.joint_names, track.joint_deviation[0], strict=True))
    assert np.isnan(track.joint_deviation[1]).all()
    assert apart["right_wrist"] > 2.0 * apart["left_wrist"]


def test_angles_are_as_sure_as_their_hypotheses_agree() -> None:
    """An elbow that may be straight, at a quarter of the weight, is as unsure as that; others are not."""
    whole = human()
    model = activate(whole, DEFAULT_ACTIVE, np.zeros(len(whole.dof_names)))
    straight = np.zeros(len(model.dof_names))
    bent = straight.copy()
    bent[model.dof("r_elbow_flexion")] = 1.5
    joints = joint_positions(model, bent[None])[0]
    poses, weights = np.stack([bent, straight]), np.array([0.75, 0.25])
    statuses: tuple[Status, ...] = ("tracked", "lost")
    track = assemble(
        model, [Estimate(0, 0.0, status, bent, joints, poses, weights, 0.01) for status in statuses]
    )
    assert track.angle_names is not None
    assert track.angle is not None
    assert track.angle_deviation is not None
    found = dict(zip(track.angle_names, track.angle[0], strict=True))
    apart = dict(zip(track.angle_names, track.angle_deviation[0], strict=True))
    assert found["right_elbow_flexion"] == pytest.approx(1.5)
    assert apart["right_elbow_flexion"] == pytest.approx(np.hypot(ANGLE_MISFIT, UNSEEN * 0.75))
    assert apart["left_elbow_flexion"] == pytest.approx(ANGLE_MISFIT)
    assert np.isnan(track.angle_deviation[1]).all()
