"""Eight features that describe the certainty of a joint of a reported pose.

Two come from the frame: the visible share of the surface around the joint that faces the camera, and the
normalised residual of the body. Two come from the filter: the spread of the hypotheses, and the speed of the
joint. Four come from the pose: joints are wrong more often in bent limbs and folded bodies, near other
joints, and far in front of or behind the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.frame import SubjectFrame
from gepf.common.kinematics import joint_positions
from gepf.coordinator.settings import CertaintySettings

STILL_M = 1e-9  # rounding of the place of a joint that does not move


@dataclass(frozen=True, slots=True, eq=False)
class FrameContext:
    """The data from which the pose of a frame was estimated, apart from the hypotheses."""

    subject: SubjectFrame
    past: Array  # (D,) the pose reported before
    interval: float  # seconds since then
    stretch: float  # ratio of lateral to depth noise
    first: bool = False  # the pose before is only a guess


class Features(NamedTuple):
    """Features of each joint (J,). Features of the whole body are the same for all joints."""

    seen: Array  # visible share of the surface around it that faces the camera that sees it best
    residual: Array  # normalised residual of the body
    spread: Array  # logarithm of the root mean square distance of the hypotheses, metres
    speed: Array  # logarithm, metres per second
    bend: Array  # sum of the squared angles from the root to the joint, rad^2
    folding: Array  # of the body: mean change of the distances between joints since the pose at rest, metres
    crowding: Array  # number of nearby joints minus that in the pose at rest
    protrusion: Array  # metres in front of or behind the mean joint


def measure_features(
    model: BodyModel,
    pose: Array,
    joints: Array,
    weights: Array,
    context: FrameContext,
    residual: float,
    seen_by: Array,
    settings: CertaintySettings,
) -> Features:
    """The features of a reported pose (D,) with this normalised residual, and with shares `seen_by` (C, J).

    `joints` (1 + M, J, 3) are those of the pose and of the hypotheses, which have `weights` (M,).
    """
    (at_rest, upstream), past = rest_of(model), joint_positions(model, context.past[None])[0]
    joints, hypotheses = joints[0], joints[1:]
    squares = np.sum((hypotheses - joints) ** 2, axis=-1)
    spread = np.sqrt(weights @ squares / weights.sum())
    speed = np.linalg.norm(joints - past, axis=1) / context.interval
    distances = between(joints)
    ahead = context.subject.frame.to_camera(joints)[:, 2]
    folding = np.sqrt(np.mean((distances - at_rest) ** 2, axis=1)).mean()
    return Features(
        seen=seen_by.max(axis=0),
        residual=np.full(len(joints), residual),
        spread=np.log(spread + settings.spread_floor_m),
        speed=np.log(speed + settings.speed_floor_m_s),
        bend=upstream @ pose**2,
        folding=np.full(len(joints), folding),
        crowding=count_near(distances, settings.crowded_m) - count_near(at_rest, settings.crowded_m),
        protrusion=np.abs(ahead - ahead.mean()),
    )


def between(joints: Array) -> Array:
    """Distances (J, J) between joints (J, 3)."""
    return np.asarray(np.linalg.norm(joints[:, None] - joints, axis=-1))


def count_near(distances: Array, near_m: float) -> Array:
    """Number of joints near each joint (J,), from their distances (J, J)."""
    return np.asarray(np.exp(-0.5 * (distances / near_m) ** 2).sum(axis=1))


@lru_cache(maxsize=16)
def movable_joints(model: BodyModel) -> Mask:
    """Which joints (J,) a degree of freedom moves; not those of a held base, nor the first on it."""
    poses = np.stack([np.zeros(len(model.kinds)), np.linspace(0.3, 0.7, len(model.kinds))])
    rest, pose = joint_positions(model, poses)
    return np.asarray(np.linalg.norm(pose - rest, axis=1) > STILL_M)


@lru_cache(maxsize=16)
def rest_of(model: BodyModel) -> tuple[Array, Mask]:
    """Of a body's joints at rest: distances (J, J), metres, and which angles (J, D) are above each joint."""
    count = len(model.kinds)
    turns = (model.kinds == ROTATION) & ~np.isin(model.dof_names, ROOT_DOFS)
    upstream = np.zeros((count + 1, count), dtype=np.bool_)  # the last is for fixed joints
    for dof, parent in enumerate(model.parents):
        upstream[dof] = upstream[parent]
        upstream[dof, dof] = turns[dof]
    at_rest = joint_positions(model, np.zeros((1, count)))[0]
    return between(at_rest), upstream[model.link_dofs[model.joint_links]]
