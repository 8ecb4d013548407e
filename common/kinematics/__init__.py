"""Kinematics of an articulated body, batched over particles.

`chain` holds forward kinematics (Eq. 1) and the axes of relative motion (Eq. 2), `skinning` what follows
for points of the body, `manifold` the steps from pose to pose, `limits` its angles within those of the
joints, `rotations` what they all stand on. The functions that take a `BodyModel` are imported from here,
compiled kernels from their modules.
"""

from common.kinematics.chain import dof_transforms, link_transforms, step_axes
from common.kinematics.limits import natural_angles, within_limits
from common.kinematics.manifold import difference, retract
from common.kinematics.skinning import bounding_box, joint_positions, pose_vertices

__all__ = [
    "bounding_box",
    "difference",
    "dof_transforms",
    "joint_positions",
    "link_transforms",
    "natural_angles",
    "pose_vertices",
    "retract",
    "step_axes",
    "within_limits",
]
