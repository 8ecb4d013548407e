"""Where a body stands whose joints are known: put among the points, turned in many ways, and refined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from common.activation import activate
from common.body import ROOT_DOFS, BodyModel
from common.camera import back_project
from common.frame import SubjectFrame
from common.kinematics import pose_vertices
from common.settings import RefineSettings
from coordinator.bodies.tracked import name_pose
from coordinator.tracking.refiner import Refiner

Array = NDArray[np.float64]

YAWS_DEG = tuple(np.arange(0.0, 360.0, 22.5))  # turns about the vertical
FACING_DEG = (-45.0, -22.5, 0.0, 22.5, 45.0)  # of people, whose back looks much like their front
ELEVATIONS_DEG = (0.0, 25.0)  # a camera that looks level or down
ROUNDS = 12  # of ICP
INWARD = 0.25  # of the body's depth: points lie on the near side


def place(
    full: BodyModel,
    values: Mapping[str, float],
    subject: SubjectFrame,
    refiner: Refiner,
    settings: RefineSettings,
    yaws_deg: Sequence[float] = YAWS_DEG,
) -> dict[str, float]:
    """Values of the root's degrees of freedom at which the body explains the published frame best.

    Args:
        full: The body with all its degrees of freedom.
        values: Of its joints, and of the root what is known of it: a turn that is given is kept.
        subject: The frame, cut out.
        refiner: Has poses refined on it.
        settings: How.
        yaws_deg: Turns about the vertical that are tried where none is given.
    """
    held = name_pose(full, values)
    model = activate(full, ROOT_DOFS, held)
    poses = candidates(model, held[[full.dof(name) for name in model.dof_names]], subject, yaws_deg)
    rules = msgspec.structs.replace(settings, icp_iterations=ROUNDS)
    refined = refiner.submit(model, poses, rules).result()
    best = refined.poses[int(np.argmax(refined.log_likelihood))]
    return dict(zip(model.dof_names, best.tolist(), strict=True))


def candidates(model: BodyModel, pose: Array, subject: SubjectFrame, yaws_deg: Sequence[float]) -> Array:
    """Poses (N, 6) of the root: the given turn, or many, each with the body's middle where the points' is."""
    turned = [model.dof(name) for name in ROOT_DOFS[3:]]
    poses = pose[None].copy()
    if not pose[turned].any():
        turns = np.radians([(down, yaw, 0.0) for down in ELEVATIONS_DEG for yaw in yaws_deg])
        poses = np.tile(pose, (len(turns), 1))
        poses[:, turned] = turns
    poses[:, [model.dof(name) for name in ROOT_DOFS[:3]]] = 0.0
    surfaces = pose_vertices(model, poses)  # (N, V, 3)
    low, high = surfaces.min(axis=1), surfaces.max(axis=1)
    middle = 0.5 * (low + high)
    middle[:, 2] -= INWARD * (high - low)[:, 2]
    poses[:, [model.dof(name) for name in ROOT_DOFS[:3]]] = middle_of(subject) - middle
    return poses


def middle_of(subject: SubjectFrame) -> Array:
    """The middle (3,) of what is seen of the subject, camera frame, metres."""
    frame = subject.frame
    points = back_project(frame.metres().astype(np.float64), frame.intrinsics).reshape(-1, 3)
    low, high = np.percentile(points[subject.picked], [2.0, 98.0], axis=0)
    middle: Array = 0.5 * (low + high)
    return middle
