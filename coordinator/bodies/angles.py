"""Anatomical angles of a body: continuous, with plain names.

The pose has the degrees of freedom of the tracker; the three of a spherical joint are Euler angles, which
jump if the middle one is near 90 degrees. The angles here are for users: flexion, abduction and rotation of a
person, from swing and twist; joint values of a robot.

A joint is the motion of a segment relative to its carrier. It has three angles: two of the swing of the
moving bone and one of the twist about it. They are zero if the bone is parallel to the carrier's axis and the
hinge axes point to the side: arms straight down along the trunk (the template's arms differ from that by
`ARM_TILT`, so its rest pose has this abduction), legs and spine straight.

Signs are alike on both sides: flexion is forward (knee: the heel back), abduction away from the body,
rotation inward; trunk, neck and pelvis bend forward, lean to the person's right and turn to the left.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from gepf.common.arrays import Array, Mask
from gepf.common.body import ROOT_DOFS, ROTATION, BodyModel
from gepf.common.camera import level_from_camera
from gepf.coordinator.bodies.human.dofs import JOINT_ANGLES
from gepf.coordinator.bodies.human.skeleton import ARM_TILT, Dof, build_skeleton
from gepf.coordinator.bodies.swing_twist import (
    FARTHEST,
    compose,
    nearest_swing,
    nearest_turn,
    quaternions,
    swing_twist,
)

SIDES = {"r": "right", "l": "left"}
NECK_FLEXION = "neck_flexion"
MIRROR = np.array([1.0, -1.0, -1.0])
"""Signs that convert rotation vectors of a right limb to those of its mirror image."""

SHOWN_FROM_BEND = np.radians(20.0)
"""Least flexion of the elbow at which the rotation of the upper arm is visible."""

_LIMB_BONES = {
    # joint: carrier, moving segment, angle of the bone to the vertical at rest
    "shoulder": ("vt1", "{side}_upper_arm", ARM_TILT),
    "hip": ("pelvis", "{side}_thigh", 0.0),
}
_WORDS = {"twisting": "rotation", "rotate": "rotation", "abduct": "abduction", "pivot": "deviation"}
_OWN_NAMES = {
    "elbow_twisting": "forearm_pronation",
    "subtalar_flexion": "subtalar_inversion",
    "metatarsal_flexion": "toes_flexion",
}


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
    dofs: tuple[Dof, ...]
    mirrored: bool = False
    upward: bool = False
    tilt: float = 0.0


@dataclass(frozen=True, slots=True)
class RevoluteJoint:
    """A joint with one degree of freedom."""

    name: str
    dof: str


def plain_name(dof: str) -> str:
    """The plain name of a degree of freedom: `r_elbow_flexion` is `right_elbow_flexion`."""
    side, _, motion = dof.partition("_")
    if side not in SIDES:
        return dof
    stem, _, last = motion.rpartition("_")
    return f"{SIDES[side]}_{_OWN_NAMES.get(motion) or f'{stem}_{_WORDS.get(last, last)}'}"


@cache
def anatomical_joints() -> tuple[tuple[SphericalJoint, ...], tuple[RevoluteJoint, ...]]:
    """All joints of the template; each degree of freedom except translations of the root belongs to one."""
    spherical = [whole_body("pelvis")]
    for name, carrier, segment in (("trunk", "pelvis", "vt1"), ("neck", "vt1", "skull")):
        names = (f"{name}_flexion", f"{name}_side_bending", f"{name}_rotation")
        spherical.append(SphericalJoint(names, _between(carrier, segment), upward=True))
    for side, word in SIDES.items():
        for joint, (carrier, segment, tilt) in _LIMB_BONES.items():
            names = (f"{word}_{joint}_flexion", f"{word}_{joint}_abduction", f"{word}_{joint}_rotation")
            chain = _between(carrier, segment.format(side=side))
            spherical.append(SphericalJoint(names, chain, mirrored=side == "r", tilt=tilt))
    within = {dof.name for each in spherical for dof in each.dofs}
    revolute = [
        RevoluteJoint(plain_name(dof.name), dof.name)
        for dof in build_skeleton().dofs
        if dof.kind == ROTATION and dof.name not in within
    ]
    return tuple(spherical), tuple(revolute)


def whole_body(name: str) -> SphericalJoint:
    """The orientation of the root in the camera's axes, relative to the body's heading."""
    names = (f"{name}_forward_tilt", f"{name}_side_tilt", f"{name}_turn")
    dofs = tuple(dof for dof in build_skeleton().dofs if dof.name in ROOT_DOFS[3:])
    return SphericalJoint(names, dofs, upward=True)


def _between(carrier: str, segment: str) -> tuple[Dof, ...]:
    """The degrees of freedom after the carrier's last up to the segment's last, outward."""
    skeleton = build_skeleton()
    by_name = {dof.name: dof for dof in skeleton.dofs}
    chain: list[Dof] = []
    name: str | None = skeleton.links[segment]
    while name is not None and name != skeleton.links[carrier]:
        chain.append(by_name[name])
        name = by_name[name].parent
    return tuple(reversed(chain))


@dataclass(frozen=True)
class Angles:
    """The angles of a body, as functions of its pose.

    Args:
        dof_names: Degrees of freedom (D,) of the poses.
        spherical: Joints with swing and twist; the first is the rotation of the whole body, if it moves.
        revolute: Joints with one degree of freedom.
        held: Values of held degrees of freedom, radians; zero if missing.
        level: Rotation vector from the camera's axes to those for the rotation of the whole body.
    """

    dof_names: tuple[str, ...]
    spherical: tuple[SphericalJoint, ...]
    revolute: tuple[RevoluteJoint, ...]
    held: Mapping[str, float]
    level: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the angles (A,); first three per spherical joint, then the others."""
        return (
            *(name for joint in self.spherical for name in joint.names),
            *(joint.name for joint in self.revolute),
        )

    def measure(self, poses: Array) -> Array:
        """Angles (N, A) of poses (N, D), radians, each the value nearest to zero."""
        swing, twist = swing_twist(self.turned(self.spherical, poses))
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
        twist = nearest_turn(here[..., 2], there[..., 2], np.where(free, np.inf, FARTHEST))
        turned = np.concatenate([swing, twist[..., None]], axis=-1).reshape(len(angles), first)
        return np.concatenate([turned, nearest_turn(angles[:, first:], reference[:, first:])], axis=1)

    @cached_property
    def levers(self) -> dict[int, int]:
        """Angles that are visible only if another is bent, with that other: rotations of upper arms."""
        names = self.names
        return {
            names.index(f"{side}_shoulder_rotation"): names.index(f"{side}_elbow_flexion")
            for side in SIDES.values()
            if {f"{side}_shoulder_rotation", f"{side}_elbow_flexion"} <= set(names)
        }

    def follow(self, angles: Array, unknown: Mask | None = None) -> Array:
        """Angles (F, A) of successive frames, each at the value nearest to the last.

        Rotations that are not visible, because the elbow is straight, and `unknown` (F,) frames are not used
        as reference for the next frame.
        """
        return self.follow_on(angles, unknown, None)[0]

    def follow_on(self, angles: Array, unknown: Mask | None, last: Array | None) -> tuple[Array, Array]:
        """The same for frames that follow others, whose reference is `last` (A,), and the next reference."""
        angles, is_first = angles.copy(), last is None
        last = (angles[0] if len(angles) else np.empty(0)) if last is None else last
        last = last.copy()
        for number, frame in enumerate(angles):
            if number > 0 or not is_first:
                frame[:] = self.near(frame[None], last)[0]
            if unknown is not None and unknown[number]:
                continue
            hidden = [twist for twist, bend in self.levers.items() if frame[bend] < SHOWN_FROM_BEND]
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
        moved = set(self.dof_names) | {name for name, value in self.held.items() if value}
        chains = [[dof for dof in joint.dofs if dof.name in moved] for joint in joints]
        longest = max(map(len, chains), default=0)
        axes, values = np.zeros((len(joints), longest, 3)), np.zeros((len(poses), len(joints), longest))
        levels = [self.level if joint.dofs[0].name in ROOT_DOFS else (0.0, 0.0, 0.0) for joint in joints]
        total = np.tile(quaternions(np.array(levels).reshape(-1, 3)), (len(poses), 1, 1))
        for j, joint in enumerate(joints):
            for k, dof in enumerate(chains[j]):
                axes[j, k] = np.asarray(dof.axis) * (MIRROR if joint.mirrored else 1.0)
                values[:, j, k] = self._value(dof.name, poses)
        turns = quaternions(values[..., None] * axes)
        for k in range(longest):
            total = compose(total, turns[:, :, k])
        hanging = [[0.0, 0.0, -joint.tilt] for joint in joints]  # from the vertical to a left limb's bone
        return compose(total, quaternions(np.array(hanging).reshape(-1, 3)))

    def _value(self, dof: str, poses: Array) -> Array:
        if dof in self.dof_names:
            return poses[:, self.dof_names.index(dof)]
        return np.full(len(poses), self.held.get(dof, 0.0))


def angles_of(model: BodyModel, held: Mapping[str, float] | None = None, up: Array | None = None) -> Angles:
    """The angles of a tracked body: anatomical ones of a person, joint values of other bodies.

    With `up` (3,), away from the ground in the camera frame, angles of the whole body are relative to the
    vertical.
    """
    if is_person(model.dof_names):
        return person_angles(model.dof_names, held or {}, up)
    base = (whole_body("base"),) if set(ROOT_DOFS[3:]) & set(model.dof_names) else ()
    revolute = tuple(RevoluteJoint(name, name) for name in model.joints_of(ROTATION))
    return Angles(model.dof_names, base, revolute, held or {}, level_turn(up))


def level_turn(up: Array | None) -> tuple[float, float, float]:
    """The rotation vector to the axes of the levelled camera."""
    if up is None:
        return 0.0, 0.0, 0.0
    from scipy.spatial.transform import Rotation  # slow to load

    x, y, z = Rotation.from_matrix(level_from_camera(up)).as_rotvec().tolist()
    return x, y, z


def is_person(dof_names: Sequence[str]) -> bool:
    """Whether the degrees of freedom are those of a person, by their MPEG-4 names."""
    joints = set(dof_names) - set(ROOT_DOFS)
    return bool(joints) and joints <= set(JOINT_ANGLES)


def person_angles(dof_names: tuple[str, ...], held: Mapping[str, float], up: Array | None = None) -> Angles:
    """The anatomical angles of the joints that move.

    If only one tilt of the neck moves, it is the flexion, and the neck has no other angles.
    """
    spherical, revolute = anatomical_joints()
    moving = set(dof_names)
    turned = moving | {name for name, value in held.items() if value}
    neck = next(joint for joint in spherical if NECK_FLEXION in joint.names)
    bent = [dof.name for dof in neck.dofs if dof.name in turned]
    if len(bent) == 1 and bent[0].endswith("_tilt"):
        spherical = tuple(joint for joint in spherical if joint is not neck)
        revolute = (RevoluteJoint(NECK_FLEXION, bent[0]), *revolute)
    return Angles(
        dof_names,
        tuple(joint for joint in spherical if moving & {dof.name for dof in joint.dofs}),
        tuple(joint for joint in revolute if joint.dof in moving),
        held,
        level_turn(up),
    )
