"""How much a frame tells of a person's stature, by the pose.

Whoever stands upright shows it: a frame counts less the more the body is bent, and the worse it is explained.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.kinematics import joint_positions

Array = NDArray[np.float64]

UPRIGHT = (0.97, 0.99)  # neck (or head) to ankle, as a share of a straight body's: bent, and straight
BENT = 0.01  # weight of a bent body's frame
RAISED = 0.2  # weight of a frame in which a hand is above its shoulder
EXPLAINED = -10.0  # log likelihood from which on a frame counts in full


class Stance(NamedTuple):
    """What a pose shows of a person's stature."""

    upright: float  # from the neck to the farther ankle, as a share of what it is at rest
    long: float  # the same from the head: who looks down is shorter
    raised: bool  # whether a hand is above its shoulder

    @property
    def bent(self) -> bool:
        """Whether it shows next to nothing."""
        return self.upright <= UPRIGHT[0]

    @property
    def looks_down(self) -> bool:
        """Whether the head is bent so far that the body's length is not seen."""
        return self.long <= UPRIGHT[0]

    @property
    def shows_length(self) -> bool:
        """Whether head and soles are about as far apart as the person is tall."""
        return not (self.bent or self.looks_down)

    def weigh(self, log_likelihood: float) -> float:
        """What a frame counts that shows it: 1 if upright, hands down and well explained."""
        bent, straight = UPRIGHT
        share = float(np.clip((self.upright - bent) / (straight - bent), BENT, 1.0))
        share *= float(min(1.0, EXPLAINED / min(log_likelihood, EXPLAINED)))
        return RAISED * share if self.raised else share


def stance_of(model: BodyModel, pose: Array) -> Stance:
    """How a person stands in a pose (D,)."""
    joints: Array = joint_positions(model, pose[None])[0]
    (upright, long), at_rest = lengths_of(model, joints), lengths_at_rest(model)
    return Stance(upright / at_rest[0], long / at_rest[1], has_raised(model, joints))


@lru_cache(maxsize=16)
def lengths_at_rest(model: BodyModel) -> tuple[float, float]:
    """How far neck and head are from the farther ankle at rest, metres."""
    return lengths_of(model, joint_positions(model, np.zeros((1, len(model.kinds))))[0])


def lengths_of(model: BodyModel, joints: Array) -> tuple[float, float]:
    """How far neck and head are from the farther ankle, metres, by joints (J, 3)."""
    head, *ankles = ends_of(model)
    neck = model.joint_names.index("neck")
    apart = np.linalg.norm(joints[[neck, head]][:, None] - joints[ankles], axis=-1).max(axis=1)
    return float(apart[0]), float(apart[1])


def ends_of(model: BodyModel) -> list[int]:
    """Joints between which a person's stature lies: the head and both ankles."""
    return [model.joint_names.index(name) for name in ("head", "left_ankle", "right_ankle")]


def has_raised(model: BodyModel, joints: Array) -> bool:
    """Whether a hand is above its shoulder along the trunk, by joints (J, 3).

    Shoulders rise with arms then, by no joint of the model.
    """
    at = dict(zip(model.joint_names, joints, strict=True))
    trunk = at["neck"] - at["pelvis"]
    over = [at[f"{side}_wrist"] - at[f"{side}_shoulder"] for side in ("left", "right")]
    return any(offset @ trunk > 0.0 for offset in over)
