"""Kinematics of an articulated body, batched over particles.

`chain`: forward kinematics (Eq. 1), the axes of relative motion (Eq. 2), and the points of the body.
`manifold`: steps from pose to pose, and the limits of joints. `rotations`: shared functions of rotations.
Functions of a `BodyModel` are imported from here, compiled kernels from their modules.
"""

from gepf.common.kinematics.chain import (
    dof_transforms,
    joint_positions,
    link_transforms,
    pose_vertices,
    shaped,
)
from gepf.common.kinematics.keypoints import keypoint_positions
from gepf.common.kinematics.manifold import difference, natural_angles, retract, within_limits

__all__ = [
    "difference",
    "dof_transforms",
    "joint_positions",
    "keypoint_positions",
    "link_transforms",
    "natural_angles",
    "pose_vertices",
    "retract",
    "shaped",
    "within_limits",
]
