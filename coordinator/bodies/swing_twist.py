"""Decomposition of rotations: a twist about a bone, followed by a swing of the bone.

R = swing(s) twist(t): the twist rotates about the vertical (y) by `t`, the swing about the horizontal vector
`s` by its length. The components of `s` are singular only if the bone points in the opposite direction (a
swing of 180 degrees); Euler angles are singular at 90 degrees. See Grassia, "Practical parameterization of
rotations using the exponential map", Journal of Graphics Tools 3 (1998).
"""

from __future__ import annotations

from math import tau

import msgspec
import numpy as np

from gepf.common.arrays import Array, Mask


class SwingTwistLimits(msgspec.Struct, frozen=True):
    """How far the joints of people rotate, radians; larger angles are replaced by equivalent ones."""

    max_turn: float = np.radians(270.0)  #: to either side; beyond, a full turn is subtracted
    max_behind: float = np.radians(90.0)  #: of a limb, backward or inward; a larger swing is over the head
    max_overhead: float = np.radians(225.0)  #: of such a swing over the head


LIMITS = SwingTwistLimits()


def quaternions(vectors: Array) -> Array:
    """Quaternions (..., 4), x to w, of rotation vectors (..., 3)."""
    half = 0.5 * np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.concatenate([0.5 * np.sinc(half / np.pi) * vectors, np.cos(half)], axis=-1)


def compose(after: Array, first: Array) -> Array:
    """Products (..., 4) of quaternions: the rotation `first`, followed by `after`."""
    a, b = after[..., :3], first[..., :3]
    real = after[..., 3] * first[..., 3] - np.sum(a * b, axis=-1)
    across = a[..., [1, 2, 0]] * b[..., [2, 0, 1]] - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]
    imaginary = after[..., 3:] * b + first[..., 3:] * a + across
    return np.concatenate([imaginary, real[..., None]], axis=-1)


def swing_twist(turned: Array) -> tuple[Array, Array]:
    """Swings (..., 2), about x and z, and twists (...), about y, in (-pi, pi], of quaternions (..., 4)."""
    x, y, z, w = np.moveaxis(np.where(turned[..., 3:] < 0.0, -turned, turned), -1, 0)
    twist = 2.0 * np.arctan2(y, w)
    twist = np.where(twist > np.pi, twist - tau, np.where(twist <= -np.pi, twist + tau, twist))
    c, s = np.cos(0.5 * twist), np.sin(0.5 * twist)
    across = np.stack([x * c + z * s, z * c - x * s], axis=-1)  # the quaternion times the twist's inverse
    sine = np.hypot(across[..., 0], across[..., 1])
    angle = 2.0 * np.arctan2(sine, np.abs(w * c + y * s))
    sign = np.where(w * c + y * s < 0.0, -1.0, 1.0)
    scale = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 2.0)
    return across * (sign * scale)[..., None], twist


def nearest_swing(swings: Array, reference: Array, limb: bool | Mask = False) -> Array:
    """The swings (..., 2), or the equivalent opposite ones, whichever are nearer to `reference`.

    For a jump by more than `max_behind`, directions that are impossible for limbs, backward or inward, are
    not chosen. `limb` says which swings (...) are those of limbs.
    """
    angle = np.hypot(swings[..., 0], swings[..., 1])
    other = swings * (1.0 - tau / np.maximum(angle, 1e-9))[..., None]
    reach = tau - angle
    far, other_far = (np.hypot(*np.moveaxis(s - reference, -1, 0)) for s in (swings, other))
    wound = (reach <= LIMITS.max_turn) & (other_far < far)
    behind, other_behind = (np.minimum(s[..., 0], s[..., 1]) < -LIMITS.max_behind for s in (swings, other))
    forced = (wound & (behind | ~other_behind)) | (behind & ~other_behind & (reach <= LIMITS.max_overhead))
    wound = np.where(limb & (np.where(wound, other_far, far) > LIMITS.max_behind), forced, wound)
    return np.where(wound[..., None], other, swings)


def nearest_turn(angles: Array, reference: Array | float, farthest: float | Array = np.inf) -> Array:
    """Angles (...) shifted by full turns towards `reference`, within +-`farthest`."""
    near = angles + tau * np.round((reference - angles) / tau)
    near = np.where(near > farthest, near - tau, near)
    return np.where(near < -farthest, near + tau, near)
