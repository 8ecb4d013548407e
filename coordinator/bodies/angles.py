"""Angles of a body for users: continuous, with plain names.

The pose has the degrees of freedom of the tracker; the three of a spherical joint are Euler angles, which
jump if the middle one is near 90 degrees. The angles here are of swing and twist, and the values of joints
with one degree of freedom. A family says which joints a body has.

A joint is the motion of a segment relative to its carrier. It has three angles: two of the swing of the
moving bone and one of the twist about it. They are zero if the bone is parallel to the carrier's axis and the
hinge axes point to the side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gepf.common.arrays import Array, Indices, Mask
from gepf.common.body import ROOT_DOFS
from gepf.common.camera import level_from_camera
from gepf.coordinator.bodies.swing_twist import (
    LIMITS,
    compose,
    nearest_swing,
    nearest_turn,
    quaternions,
    swing_twist,
)

MIRROR = np.array([1.0, -1.0, -1.0])
"""Signs that convert rotation vectors of a right limb to those of its mirror image."""


class Turn(NamedTuple):
    """A degree of freedom that rotates."""

    name: str
    axis: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class SphericalJoint:
    """A joint with swing and twist.

    Args:
        names: Names of the forward, sideways and twist angles.
        dofs: Its degrees of freedom, from the carrier outward.
        mirrored: Whether it belongs to a right limb.
        upward: Whether the moving segment points up at rest, like the trunk; limbs point down.
        tilt: Angle of the bone to the vertical at rest, radians.
    """

    names: tuple[str, str, str]
    dofs: tuple[Turn, ...]
    mirrored: bool = False
    upward: bool = False
    tilt: float = 0.0


@dataclass(frozen=True, slots=True)
class RevoluteJoint:
    """A joint with one degree of freedom."""

    name: str
    dof: str


class Chains(NamedTuple):
    """The degrees of freedom (K) of several joints (J), from the carriers outward."""

    columns: Indices  # (J, K) of poses; -1 if it is held
    held: Array  # (J, K) values of the held degrees of freedom
    axes: Array  # (J, K, 3)
    level: Array  # (J, 4) quaternions, x to w, of the carriers
    hanging: Array  # (J, 4) quaternions from the vertical to a left limb's bone


def whole_body(name: str) -> SphericalJoint:
    """The orientation of the root in the camera's axes, relative to the body's heading."""
    names = (f"{name}_forward_tilt", f"{name}_side_tilt", f"{name}_turn")
    axes = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    return SphericalJoint(names, tuple(map(Turn, ROOT_DOFS[3:], axes)), upward=True)


@dataclass(frozen=True)
class Angles:
    """The angles of a body, as functions of its pose.

    Args:
        dof_names: Degrees of freedom (D,) of the poses.
        spherical: Joints with swing and twist; the first is the rotation of the whole body, if it moves.
        revolute: Joints with one degree of freedom.
        held: Values of held degrees of freedom, radians; zero if missing.
        level: Rotation vector from the camera's axes to those for the rotation of the whole body.
        misfit: Least error of an angle, radians, because the body differs from the model; 0 if it does not.
        bends: Twist that is visible only if another angle is bent -> that other angle, both by name.
        shown_by: Name of an angle -> joint whose position shows it, and joint about which that one moves.
    """

    dof_names: tuple[str, ...]
    spherical: tuple[SphericalJoint, ...]
    revolute: tuple[RevoluteJoint, ...]
    held: Mapping[str, float]
    level: tuple[float, float, float] = (0.0, 0.0, 0.0)
    misfit: float = 0.0
    bends: Mapping[str, str] = field(default_factory=dict)
    shown_by: Mapping[str, tuple[str, str]] = field(default_factory=dict)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the angles (A,); first three per spherical joint, then the others."""
        return (
            *(name for joint in self.spherical for name in joint.names),
            *(joint.name for joint in self.revolute),
        )

    def measure(self, poses: Array) -> Array:
        """Angles (N, A) of poses (N, D), radians, each the value nearest to zero."""
        swing, twist = swing_twist(turned(self._chains, poses))
        parts = [self._in_names(joint, swing[:, j], twist[:, j]) for j, joint in enumerate(self.spherical)]
        revolute = [self._value(joint.dof, poses)[:, None] for joint in self.revolute]
        return np.concatenate([np.empty((len(poses), 0)), *parts, *revolute], axis=1)

    def near(self, angles: Array, reference: Array) -> Array:
        """The angles (N, A), each at the equivalent value nearest to `reference` (A,) or (N, A).

        A swing by s equals a swing by 360 degrees - s in the opposite direction, and angles can differ by
        full turns.
        """
        reference, first = np.broadcast_to(reference, angles.shape), 3 * len(self.spherical)
        shape = len(angles), len(self.spherical), 3
        here, there = (each[:, :first].reshape(shape) for each in (angles, reference))
        limb = np.array([not joint.upward for joint in self.spherical], dtype=np.bool_)
        free = np.array([joint.dofs[0].name in ROOT_DOFS for joint in self.spherical], dtype=np.bool_)
        swing = nearest_swing(here[..., :2], there[..., :2], limb)
        twist = nearest_turn(here[..., 2], there[..., 2], np.where(free, np.inf, LIMITS.max_turn))
        turned = np.concatenate([swing, twist[..., None]], axis=-1).reshape(len(angles), first)
        return np.concatenate([turned, nearest_turn(angles[:, first:], reference[:, first:])], axis=1)

    @cached_property
    def levers(self) -> dict[int, int]:
        """Index of each twist that is visible only if another angle is bent -> index of that other angle."""
        at = {name: number for number, name in enumerate(self.names)}
        pairs = self.bends.items()
        return {at[twist]: at[bend] for twist, bend in pairs if twist in at and bend in at}

    def follow(self, angles: Array, unknown: Mask | None = None) -> Array:
        """Angles (F, A) of successive frames, each at the value nearest to the last.

        Twists that are not visible, because another joint is straight, and `unknown` (F,) frames are not used
        as reference for the next frame.
        """
        return self.follow_on(angles, unknown, None)[0]

    def follow_on(self, angles: Array, unknown: Mask | None, last: Array | None) -> tuple[Array, Array]:
        """As `follow`, for frames after a reference `last` (A,); also returns the next reference."""
        angles, is_first = angles.copy(), last is None
        min_bend = np.radians(20.0)  # of an elbow at which the twist of the upper arm is visible
        last = (angles[0] if len(angles) else np.empty(0)) if last is None else last
        last = last.copy()
        for number, frame in enumerate(angles):
            if number > 0 or not is_first:
                frame[:] = self.near(frame[None], last)[0]
            if unknown is not None and unknown[number]:
                continue
            hidden = [twist for twist, bend in self.levers.items() if frame[bend] < min_bend]
            seen = np.delete(np.arange(len(frame)), hidden)
            last[seen] = frame[seen]
        return angles, last

    def _in_names(self, joint: SphericalJoint, swing: Array, twist: Array) -> Array:
        """Forward, sideways and twist angles (N, 3) of one joint."""
        x, z = swing.T
        if not joint.upward:
            return np.stack([-x, -z, twist], axis=1)
        if joint.dofs[0].name in ROOT_DOFS:  # in the axes of the body after its turn
            c, s = np.cos(twist), np.sin(twist)
            x, z = c * x - s * z, s * x + c * z
        return np.stack([x, -z, -twist], axis=1)

    def turned(self, joints: Sequence[SphericalJoint], poses: Array) -> Array:
        """Quaternions (N, J, 4), x to w, of the moving segments in their carriers, from the vertical on.

        For right limbs they are those of the mirror image.
        """
        return turned(self._chains_of(joints), poses)

    @cached_property
    def _chains(self) -> Chains:
        return self._chains_of(self.spherical)

    def _chains_of(self, joints: Sequence[SphericalJoint]) -> Chains:
        """The turns of joints, as arrays."""
        columns = {name: column for column, name in enumerate(self.dof_names)}
        moved = set(self.dof_names) | {name for name, value in self.held.items() if value}
        chains = [[dof for dof in joint.dofs if dof.name in moved] for joint in joints]
        shape = len(joints), max(map(len, chains), default=0)
        axes, held, numbers = np.zeros((*shape, 3)), np.zeros(shape), np.full(shape, -1)
        for j, joint in enumerate(joints):
            for k, dof in enumerate(chains[j]):
                axes[j, k] = np.asarray(dof.axis) * (MIRROR if joint.mirrored else 1.0)
                held[j, k], numbers[j, k] = self.held.get(dof.name, 0.0), columns.get(dof.name, -1)
        levels = [self.level if joint.dofs[0].name in ROOT_DOFS else (0.0, 0.0, 0.0) for joint in joints]
        hanging = [[0.0, 0.0, -joint.tilt] for joint in joints]
        starts, ends = (quaternions(np.array(turns).reshape(-1, 3)) for turns in (levels, hanging))
        return Chains(numbers, held, axes, starts, ends)

    def _value(self, dof: str, poses: Array) -> Array:
        if dof in self.dof_names:
            return poses[:, self.dof_names.index(dof)]
        return np.full(len(poses), self.held.get(dof, 0.0))


def turned(chains: Chains, poses: Array) -> Array:
    """`Angles.turned` for the chains of joints."""
    total = np.tile(chains.level, (len(poses), 1, 1))
    values = np.where(chains.columns < 0, chains.held, poses[:, chains.columns])
    turns = quaternions(values[..., None] * chains.axes)
    for k in range(chains.columns.shape[1]):
        total = compose(total, turns[:, :, k])
    return compose(total, chains.hanging)


def level_turn(up: Array | None) -> tuple[float, float, float]:
    """The rotation vector to the axes of the levelled camera."""
    if up is None:
        return 0.0, 0.0, 0.0
    from scipy.spatial.transform import Rotation  # slow to load

    x, y, z = Rotation.from_matrix(level_from_camera(up)).as_rotvec().tolist()
    return x, y, z
