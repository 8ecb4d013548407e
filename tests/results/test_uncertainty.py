"""How sure the tracker is, from its hypotheses."""

from __future__ import annotations

import numpy as np
import pytest

from common.activation import activate
from common.kinematics import joint_positions
from coordinator.bodies.human.template import DEFAULT_ACTIVE, human
from coordinator.results.log import assemble
from coordinator.tracking.certainty.certainty import Certainty
from coordinator.tracking.estimate import Estimate, Status


def test_a_track_says_how_sure_its_estimates_are() -> None:
    """Joint by joint as the estimate has it; not a number where nobody knows."""
    whole = human()
    model = activate(whole, DEFAULT_ACTIVE, np.zeros(len(whole.dof_names)))
    pose = np.zeros(len(model.dof_names))
    joints = joint_positions(model, pose[None])[0]
    certainty = Certainty(*np.random.default_rng(0).random((3, len(joints))))
    known = Estimate(0, 0.0, "tracked", pose, joints, pose[None], np.ones(1), 0.01, certainty=certainty)
    track = assemble(model, [known, Estimate(1, 0.1, "lost", pose, joints, pose[None], np.ones(1), 0.01)])
    for found, said in (
        (track.joint_seen, certainty.seen),
        (track.joint_off_probability, certainty.off_probability),
        (track.joint_deviation, certainty.deviation),
    ):
        np.testing.assert_array_equal(found[0], said)
        assert np.isnan(found[1]).all()


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
    found = dict(zip(track.angle_names, track.angle[0], strict=True))
    apart = dict(zip(track.angle_names, track.angle_deviation[0], strict=True))
    assert found["right_elbow_flexion"] == pytest.approx(1.5)
    assert apart["right_elbow_flexion"] == pytest.approx(2.0 * 0.75, rel=0.02)
    assert 0.0 < apart["left_elbow_flexion"] < np.radians(10.0)
    assert np.isnan(track.angle_deviation[1]).all()
