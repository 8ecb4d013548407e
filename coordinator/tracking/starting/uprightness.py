"""How much a frame tells of a person's stature, by the pose.

Whoever stands upright shows it: a frame counts less the more the body is bent, and the worse it is explained.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import joint_positions

Array = NDArray[np.float64]

UPRIGHT = (0.97, 0.99)  # head to ankle, as a share of a straight body's: bent, and straight
BENT = 0.01  # weight of a bent body's frame
RAISED = 0.2  # weight of a frame in which a hand is above its shoulder
EXPLAINED = -10.0  # log likelihood from which on a frame counts in full


def uprightness(model: BodyModel, pose: Array) -> float:
    """How far the head is from the farther ankle in a pose (D,), as a share of what it is at rest."""
    head, *ankles = ends_of(model)
    posed = joint_positions(model, np.stack([np.zeros_like(pose), pose]))
    rest, now = np.linalg.norm(posed[:, ankles] - posed[:, head, None], axis=-1).max(axis=-1)
    return float(now / rest)


def ends_of(model: BodyModel) -> list[int]:
    """Joints between which a person's stature lies: the head and both ankles."""
    return [model.joint_names.index(name) for name in ("head", "left_ankle", "right_ankle")]


def is_bent(model: BodyModel, pose: Array) -> bool:
    """Whether a body in a pose (D,) shows next to nothing of its stature."""
    return uprightness(model, pose) <= UPRIGHT[0]


def has_raised(model: BodyModel, pose: Array) -> bool:
    """Whether a hand is above its shoulder, along the trunk: shoulders rise with arms, by no joint here."""
    joints = dict(zip(model.joint_names, joint_positions(model, pose[None])[0], strict=True))
    trunk = joints["neck"] - joints["pelvis"]
    over = [joints[f"{side}_wrist"] - joints[f"{side}_shoulder"] for side in ("left", "right")]
    return any(offset @ trunk > 0.0 for offset in over)


def weigh_pose(model: BodyModel, pose: Array, log_likelihood: float) -> float:
    """What a frame counts that shows a body in a pose (D,)."""
    raised = RAISED if has_raised(model, pose) else 1.0
    return raised * weigh_frame(uprightness(model, pose), log_likelihood)


def weigh_frame(upright: float, log_likelihood: float) -> float:
    """What a frame counts, hands down: 1 for one that shows an upright body and is well explained."""
    bent, straight = UPRIGHT
    share = float(np.clip((upright - bent) / (straight - bent), BENT, 1.0))
    return float(share * min(1.0, EXPLAINED / min(log_likelihood, EXPLAINED)))
