"""The body where it was followed, or where a search found it: which of the two a frame speaks for."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import joint_positions
from coordinator.filters.belief import Belief
from coordinator.tracking.inference import Situation
from coordinator.tracking.search.facing import looks_alike
from coordinator.tracking.search.seeker import Finding
from coordinator.tracking.search.verdict import weigh
from coordinator.tracking.search.watch import Watch

Array = NDArray[np.float64]

SURELY = 1.0  # log likelihood by which what is found elsewhere must explain a frame better


def decide(
    situation: Situation, rival: Finding | None, begin_with: Callable[[Finding], Belief]
) -> tuple[Belief, Watch]:
    """The hypotheses that were followed, or those of a rival, if they are likelier; and how it goes then."""
    model, belief, watch = situation.start.model, situation.belief, situation.watch
    verdict = weigh(belief.log_weights[0], belief.residual[0], situation.rules)
    if rival is None:
        return belief, watch.followed(verdict, anew=False)
    anew = False
    if rival.standing.log_likelihood[0] > belief.log_weights[0] + SURELY:
        anew = watch.seeks or rival.is_elsewhere(likeliest_joints(model, belief))
        belief, verdict = begin_with(rival), rival.verdict
    joints = likeliest_joints(model, belief)
    alike = looks_alike(model.joint_names, rival.standing, joints, belief.log_weights[0])
    return belief, watch.followed(verdict, anew=anew).searched(alike=alike)


def likeliest_joints(model: BodyModel, belief: Belief) -> Array:
    """Positions (J, 3) of the likeliest hypothesis' joints, camera frame, metres."""
    joints: Array = joint_positions(model, belief.poses[:1])[0]
    return joints
