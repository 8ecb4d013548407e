"""How a person is held, as far as that tells how sure the joints are: folded at the hips, limbs ahead."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LANDMARKS = ("neck", "pelvis", "left_knee", "right_knee")
HINGES = ("pelvis", "left_hip", "right_hip")


class Posture(NamedTuple):
    """How joints (J,) are held; all zero for what is not a person, and for one whose legs are held."""

    folded: float  # squared angle between trunk and thighs, rad^2, both legs' mean
    ahead: Array  # (J,) metres before or behind the pelvis


def posture_of(model: BodyModel, joints: Array) -> Posture:
    """Of joints (J, 3), camera frame."""
    landmarks = landmarks_of(model)
    if not len(landmarks):
        return Posture(0.0, np.zeros(len(joints)))
    neck, pelvis, left, right = joints[landmarks]
    trunk, thighs = neck - pelvis, pelvis - 0.5 * (left + right)
    along = trunk @ thighs / np.sqrt((trunk @ trunk) * (thighs @ thighs))
    return Posture(float(np.arccos(min(max(along, -1.0), 1.0)) ** 2), np.abs(joints[:, 2] - pelvis[2]))


@lru_cache(maxsize=16)
def landmarks_of(model: BodyModel) -> Indices:
    """The joints by which a posture is told, (4,); (0,) where one is missing or the legs are held."""
    if not {*LANDMARKS, *HINGES} <= set(model.joint_names):
        return np.empty(0, dtype=np.int64)
    found = np.array([model.joint_names.index(name) for name in LANDMARKS])
    pelvis, *hips = model.link_dofs[model.joint_links[[model.joint_names.index(name) for name in HINGES]]]
    return found[:0] if pelvis in hips else found
