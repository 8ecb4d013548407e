"""The shoulder's angles that the International Society of Biomechanics recommends, in the order Y, X, Y.

They are plane of elevation (0 is abduction, 90 degrees forward flexion), elevation, and axial rotation
(inward positive) of the upper arm against the trunk (Wu et al., "ISB recommendation on definitions of joint
coordinate systems ... part II: shoulder, elbow, wrist and hand", Journal of Biomechanics 38, 2005). If the
arm is straight down or straight up, plane and axial rotation have the same axis: only their sum is defined,
and each may jump from frame to frame. Flexion, abduction and rotation do not jump with the arm down.

For the hip (Wu et al. 2002) the pose itself is the recommended joint coordinate system: `r_hip_flexion`,
`r_hip_abduct` (its sign is the opposite of adduction's) and `r_hip_twisting`, in this order.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.coordinator.bodies.swing_twist import nearest_turn

ISB_ANGLES = ("plane_of_elevation", "elevation", "axial_rotation")


def isb_shoulder(angles: Array) -> Array:
    """Plane of elevation, elevation, axial rotation (N, 3) from flexion, abduction, rotation (N, 3).

    Radians. Elevation is 0 to pi, the others within (-pi, pi].
    """
    flexion, abduction, rotation = np.moveaxis(angles, -1, 0)
    elevation = np.hypot(flexion, abduction)
    beyond = elevation > np.pi
    plane = np.arctan2(flexion, abduction) + np.pi * beyond
    elevation = np.where(beyond, 2.0 * np.pi - elevation, elevation)
    return np.stack([nearest_turn(plane, 0.0), elevation, nearest_turn(rotation - plane, 0.0)], axis=-1)


def isb_names(angle_names: tuple[str, ...]) -> tuple[str, ...]:
    """The names of `isb_angles` for a body with these angles."""
    return tuple(f"{shoulder}_isb_{name}" for shoulder in shoulders(angle_names) for name in ISB_ANGLES)


def isb_angles(angle_names: tuple[str, ...], angles: Array) -> Array:
    """ISB angles (F, 3 or 6) of the shoulders from anatomical angles (F, A); radians."""
    found = [np.empty((len(angles), 0))]
    for shoulder in shoulders(angle_names):
        first = angle_names.index(f"{shoulder}_flexion")
        found.append(isb_shoulder(angles[:, first : first + 3]))
    return np.concatenate(found, axis=1)


def shoulders(angle_names: tuple[str, ...]) -> list[str]:
    """The shoulders with all three angles among these."""
    sides = ("right_shoulder", "left_shoulder")
    return [shoulder for shoulder in sides if f"{shoulder}_flexion" in angle_names]
