"""Estimates of a person that are published without tracking."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gepf.common.kinematics import joint_positions
from gepf.coordinator.tracking.certainty import unknown_certainty
from gepf.coordinator.tracking.estimate import Certainty, Estimate, Status
from tests.support.bodies import person


def estimate(frame: int, turn: float, status: Status = "tracked") -> Estimate:
    """An estimate of a person turned about the vertical by this angle."""
    pose = np.zeros(len(person().dof_names))
    pose[person().dof("root_ry")] = turn
    joints = joint_positions(person(), pose[None])[0]
    count = len(joints)
    certainty = Certainty(np.full(count, 0.75), np.full(count, 0.25), np.full(count, 0.05))
    if status == "lost":
        certainty = unknown_certainty(count)
    return Estimate(frame, frame / 30.0, status, pose, joints, pose[None], np.ones(1), 0.01, certainty)


def nobody(frame: int) -> Estimate:
    """A frame before anybody was found: nothing is known of a pose."""
    there = estimate(frame, 0.0, "lost")
    return replace(
        there,
        status="absent",
        pose=np.full_like(there.pose, np.nan),
        joint_positions=np.full_like(there.joint_positions, np.nan),
        hypothesis_pose=np.empty((0, len(there.pose))),
        hypothesis_weight=np.empty(0),
    )
