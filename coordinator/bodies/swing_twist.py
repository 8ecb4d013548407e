"""Rotations taken apart: a swing that moves a bone's line, after a twist about that line.

R = swing(s) twist(t): the twist turns about the vertical (y) by `t`, the swing about the horizontal vector
`s` by its length. The components of `s` are singular only where the bone points the opposite way (a swing of
180 degrees), and nowhere else; Euler angles are singular at 90. See Grassia, "Practical parameterization of
rotations using the exponential map", Journal of Graphics Tools 3 (1998).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

FULL_TURN = 2.0 * np.pi
FARTHEST = np.radians(270.0)
"""No joint of a person turns farther to either side: a value beyond is taken one turn back."""
BEHIND = np.radians(90.0)
"""No limb swings farther backward or inward; it may look so where it swings over the head."""
OVERHEAD = np.radians(225.0)
"""What looks like a swing backward or inward is taken as one over the head up to here."""


def swing_twist(rotations: Rotation) -> tuple[Array, Array]:
    """Swings (N, 2), about x and about z, and twists (N,) about y, in (-pi, pi]; radians."""
    x, y, z, w = np.moveaxis(rotations.as_quat(canonical=True).reshape(-1, 4), -1, 0)
    twist = 2.0 * np.arctan2(y, w)
    twist = np.where(twist > np.pi, twist - FULL_TURN, np.where(twist <= -np.pi, twist + FULL_TURN, twist))
    c, s = np.cos(0.5 * twist), np.sin(0.5 * twist)
    across = np.stack([x * c + z * s, z * c - x * s], axis=-1)  # the quaternion times the twist's inverse
    sine = np.hypot(across[:, 0], across[:, 1])
    angle = 2.0 * np.arctan2(sine, np.abs(w * c + y * s))
    sign = np.where(w * c + y * s < 0.0, -1.0, 1.0)
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return across * (sign * scale)[:, None], twist


def nearest_swing(swings: Array, reference: Array, limb: bool = False) -> Array:
    """The same swings (N, 2), or a full turn less the other way about, whichever is nearer to `reference`.

    Where a limb hops by more than `BEHIND`, it is not the way that no limb goes, backward or inward.
    """
    angle = np.linalg.norm(swings, axis=-1, keepdims=True)
    other = swings * (1.0 - FULL_TURN / np.maximum(angle, 1e-9))
    reach = FULL_TURN - angle
    far, other_far = (np.linalg.norm(s - reference, axis=-1, keepdims=True) for s in (swings, other))
    wound = (reach <= FARTHEST) & (other_far < far)
    if limb:
        behind, other_behind = (np.min(s, axis=-1, keepdims=True) < -BEHIND for s in (swings, other))
        forced = (wound & (behind | ~other_behind)) | (behind & ~other_behind & (reach <= OVERHEAD))
        wound = np.where(np.where(wound, other_far, far) > BEHIND, forced, wound)
    return np.where(wound, other, swings)


def nearest_turn(angles: Array, reference: Array, farthest: float = np.inf) -> Array:
    """Angles (N,) plus the full turns that bring them nearest to `reference`, within +-`farthest`."""
    near = angles + FULL_TURN * np.round((reference - angles) / FULL_TURN)
    near = np.where(near > farthest, near - FULL_TURN, near)
    return np.where(near < -farthest, near + FULL_TURN, near)
