"""Angles of a body as people publish them: continuous, with plain names and meanings.

The pose keeps the degrees of freedom that the tracker moves; three of them in a ball joint are Euler angles,
which jump where the middle one is near 90 degrees. These angles are for reading: flexion, abduction and
rotation from swing and twist for a person (`coordinator.bodies.human.anatomy`), joint values for a robot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from common.body import ROOT_DOFS, ROTATION, BodyModel
from common.level import level_from_camera
from coordinator.bodies.human.anatomy import (
    SIDES,
    BallJoint,
    Hinge,
    anatomical_joints,
    hanging,
    whole_body,
)
from coordinator.bodies.human.mpeg4 import JOINT_ANGLES
from coordinator.bodies.levers import SHOWN
from coordinator.bodies.swing_twist import FARTHEST, nearest_swing, nearest_turn, swing_twist

Array = NDArray[np.float64]

NECK_FLEXION = "neck_flexion"
MIRROR = np.array([1.0, -1.0, -1.0])
"""Rotation vectors of a right limb, as those of the left limb that mirrors it."""


@dataclass(frozen=True, slots=True)
class Angles:
    """Which angles a body has, and how they follow from its pose.

    Args:
        dof_names: Degrees of freedom (D,) of the poses.
        balls: Joints with swing and twist; the whole body's turn is the first, if it moves.
        hinges: Joints of one degree of freedom.
        held: Values of degrees of freedom that do not move, radians; what is not named is zero.
        level: Rotation vector from the camera's axes to those in which the whole body's turn is given.
    """

    dof_names: tuple[str, ...]
    balls: tuple[BallJoint, ...]
    hinges: tuple[Hinge, ...]
    held: Mapping[str, float]
    level: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """What the angles (A,) are called; three of each ball first, then the hinges."""
        return (
            *(name for ball in self.balls for name in ball.names),
            *(hinge.name for hinge in self.hinges),
        )

    def measure(self, poses: Array) -> Array:
        """Angles (N, A) of poses (N, D), radians; of each the value nearest to zero."""
        parts = [self._ball(ball, poses) for ball in self.balls]
        hinges = [self._value(hinge.dof, poses)[:, None] for hinge in self.hinges]
        return np.concatenate([np.empty((len(poses), 0)), *parts, *hinges], axis=1)

    def near(self, angles: Array, reference: Array) -> Array:
        """The same angles (N, A), each on the turn nearest to `reference` (A,) or (N, A).

        A swing of s is also one of 360 degrees less s the other way about, and a turn is also one more.
        """
        near, reference = angles.copy(), np.broadcast_to(reference, angles.shape)
        for b, ball in enumerate(self.balls):
            swing, twist = slice(3 * b, 3 * b + 2), 3 * b + 2
            near[:, swing] = nearest_swing(angles[:, swing], reference[:, swing], limb=not ball.upward)
            free = ball.dofs[0].name in ROOT_DOFS
            near[:, twist] = nearest_turn(angles[:, twist], reference[:, twist], np.inf if free else FARTHEST)
        first = 3 * len(self.balls)
        near[:, first:] = nearest_turn(angles[:, first:], reference[:, first:])
        return near

    @property
    def levers(self) -> dict[int, int]:
        """Angles that are seen only where another one is bent, and that other one: upper arms' rotation."""
        names = self.names
        return {
            names.index(f"{side}_shoulder_rotation"): names.index(f"{side}_elbow_flexion")
            for side in SIDES.values()
            if {f"{side}_shoulder_rotation", f"{side}_elbow_flexion"} <= set(names)
        }

    def follow(self, poses: Array, unknown: NDArray[np.bool_] | None = None) -> Array:
        """Angles (F, A) of the poses (F, D) of successive frames, each on the turn nearest to the one before.

        A rotation that nothing shows, as the elbow is straight, does not say on which turn the next one is;
        nor does anything of a frame that is `unknown` (F,).
        """
        angles = self.measure(poses)
        last = angles[0].copy() if len(angles) else np.empty(0)
        for number, frame in enumerate(angles):
            frame[:] = self.near(frame[None], last)[0]
            if unknown is not None and unknown[number]:
                continue
            hidden = [twist for twist, bend in self.levers.items() if frame[bend] < SHOWN]
            seen = np.delete(np.arange(len(frame)), hidden)
            last[seen] = frame[seen]
        return angles

    def _ball(self, ball: BallJoint, poses: Array) -> Array:
        """Forward, sideways and twisting angle (N, 3) of one joint."""
        turned = self.rotation(ball, poses) * Rotation.from_rotvec(hanging(ball))
        swing, twist = swing_twist(turned)
        if ball.upward:
            return in_heading(swing, twist) if ball.dofs[0].name in ROOT_DOFS else upward(swing, twist)
        return np.stack([-swing[:, 0], -swing[:, 1], twist], axis=1)

    def rotation(self, ball: BallJoint, poses: Array) -> Rotation:
        """Of the moving segment in its carrier (N,); a right limb's as that of its mirror image."""
        of_body = ball.dofs[0].name in ROOT_DOFS
        total = Rotation.from_rotvec(np.tile(self.level if of_body else np.zeros(3), (len(poses), 1)))
        for dof in ball.dofs:
            if dof.name in self.dof_names or self.held.get(dof.name):
                axis = np.asarray(dof.axis) * (MIRROR if ball.mirrored else 1.0)
                total *= Rotation.from_rotvec(self._value(dof.name, poses)[:, None] * axis)
        return total

    def _value(self, dof: str, poses: Array) -> Array:
        if dof in self.dof_names:
            return poses[:, self.dof_names.index(dof)]
        return np.full(len(poses), self.held.get(dof, 0.0))


def upward(swing: Array, twist: Array) -> Array:
    """Forward, to the right, to the left (N, 3) of what stands upright."""
    return np.stack([swing[:, 0], -swing[:, 1], -twist], axis=1)


def in_heading(swing: Array, twist: Array) -> Array:
    """The same with the swing in the axes of a body that has turned."""
    c, s = np.cos(twist), np.sin(twist)
    x, z = swing.T
    return upward(np.stack([c * x - s * z, s * x + c * z], axis=1), twist)


def angles_of(model: BodyModel, held: Mapping[str, float] | None = None, up: Array | None = None) -> Angles:
    """The angles of a body that is tracked: anatomical ones of a person, joint values of anything else.

    With `up` (3,), away from the ground in the camera frame, the whole body's are against the vertical.
    """
    if is_person(model.dof_names):
        return person_angles(model.dof_names, held or {}, up)
    turning = [
        name
        for name, kind in zip(model.dof_names, model.kinds, strict=True)
        if kind == ROTATION and name not in ROOT_DOFS
    ]
    base = (whole_body("base"),) if set(ROOT_DOFS[3:]) & set(model.dof_names) else ()
    hinges = tuple(Hinge(name, name) for name in turning)
    return Angles(model.dof_names, base, hinges, held or {}, level_turn(up))


def level_turn(up: Array | None) -> tuple[float, float, float]:
    """The rotation vector into the axes of a camera that is held level."""
    x, y, z = Rotation.from_matrix(level_from_camera(up)).as_rotvec().tolist()
    return x, y, z


def is_person(dof_names: Sequence[str]) -> bool:
    """Whether degrees of freedom are those of a person, by their MPEG-4 names."""
    joints = set(dof_names) - set(ROOT_DOFS)
    return bool(joints) and joints <= set(JOINT_ANGLES)


def person_angles(dof_names: tuple[str, ...], held: Mapping[str, float], up: Array | None = None) -> Angles:
    """The anatomical angles of the joints in which something moves.

    Of a neck that moves by one tilt alone that is the flexion, and there are no others.
    """
    balls, hinges = anatomical_joints()
    moving = set(dof_names)
    turned = moving | {name for name, value in held.items() if value}
    neck = next(ball for ball in balls if NECK_FLEXION in ball.names)
    bent = [dof.name for dof in neck.dofs if dof.name in turned]
    if len(bent) == 1 and bent[0].endswith("_tilt"):
        balls = tuple(ball for ball in balls if ball is not neck)
        hinges = (Hinge(NECK_FLEXION, bent[0]), *hinges)
    return Angles(
        dof_names,
        tuple(ball for ball in balls if moving & {dof.name for dof in ball.dofs}),
        tuple(hinge for hinge in hinges if hinge.dof in moving),
        held,
        level_turn(up),
    )
