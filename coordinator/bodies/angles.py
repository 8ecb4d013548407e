"""Angles of a body as people publish them: continuous, with plain names and meanings.

The pose keeps the degrees of freedom that the tracker moves; three of them in a spherical joint are Euler
angles, which jump where the middle one is near 90 degrees. These angles are for reading: of a person flexion,
abduction and rotation from swing and twist, of a robot joint values.

A joint is the motion of one segment relative to the one that carries it. Three angles describe it: two of the
swing of the moving bone and one of the twist about it. They are zero where the bone lies along the carrier's
axis and the hinge axes run from side to side: arms straight down along the trunk (the template's arms hang
`ARM_TILT` off it, so its rest pose has that much abduction), legs and spine straight.

Signs mean the same on both sides: flexion moves forward (knee: the heel back), abduction away from the body,
rotation inward; the trunk, neck and pelvis bend forward, lean to the person's right and turn to the left.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, ROTATION, BodyModel
from common.camera import level_from_camera
from coordinator.bodies.human.dofs import JOINT_ANGLES
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.human.skeleton import ARM_TILT, Dof, Skeleton, build_skeleton
from coordinator.bodies.swing_twist import FARTHEST, nearest_swing, nearest_turn, swing_twist

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

SIDES = {"r": "right", "l": "left"}
NECK_FLEXION = "neck_flexion"
MIRROR = np.array([1.0, -1.0, -1.0])
"""Rotation vectors of a right limb, as those of the left limb that mirrors it."""

SHOWN_FROM_BEND = np.radians(20.0)
"""From this bend on of its elbow, an upper arm's rotation is seen."""

_LIMB_BONES = {
    # joint: carrier, moving segment, how far the bone hangs off the vertical at rest
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
        names: Of the forward, the sideways and the twisting angle.
        dofs: What moves it, from the carrier outward.
        mirrored: Whether it belongs to a right limb.
        upward: Whether the moving segment stands upright at rest, as the trunk does; limbs hang.
        tilt: Of the bone at rest, radians.
    """

    names: tuple[str, str, str]
    dofs: tuple[Dof, ...]
    mirrored: bool = False
    upward: bool = False
    tilt: float = 0.0


@dataclass(frozen=True, slots=True)
class RevoluteJoint:
    """A joint that one degree of freedom describes."""

    name: str
    dof: str


def plain_name(dof: str) -> str:
    """What people call a degree of freedom: `r_elbow_flexion` is `right_elbow_flexion`."""
    side, _, motion = dof.partition("_")
    if side not in SIDES:
        return dof
    stem, _, last = motion.rpartition("_")
    return f"{SIDES[side]}_{_OWN_NAMES.get(motion) or f'{stem}_{_WORDS.get(last, last)}'}"


@cache
def _skeleton() -> Skeleton:
    """Of any person: axes and order are the same for all."""
    return build_skeleton(Measures.of(1.75))


@cache
def anatomical_joints() -> tuple[tuple[SphericalJoint, ...], tuple[RevoluteJoint, ...]]:
    """All joints of the template; each degree of freedom but the root's translations belongs to one."""
    spherical = tuple(_spherical_joints())
    within = {dof.name for joint in spherical for dof in joint.dofs}
    revolute = [
        RevoluteJoint(plain_name(dof.name), dof.name)
        for dof in _skeleton().dofs
        if dof.kind == ROTATION and dof.name not in within
    ]
    return spherical, tuple(revolute)


def _spherical_joints() -> Iterator[SphericalJoint]:
    yield whole_body("pelvis")
    for name, carrier, segment in (("trunk", "pelvis", "vt1"), ("neck", "vt1", "skull")):
        names = (f"{name}_flexion", f"{name}_side_bending", f"{name}_rotation")
        yield SphericalJoint(names, _between(carrier, segment), upward=True)
    for side, word in SIDES.items():
        for joint, (carrier, segment, tilt) in _LIMB_BONES.items():
            names = (f"{word}_{joint}_flexion", f"{word}_{joint}_abduction", f"{word}_{joint}_rotation")
            chain = _between(carrier, segment.format(side=side))
            yield SphericalJoint(names, chain, mirrored=side == "r", tilt=tilt)


def whole_body(name: str) -> SphericalJoint:
    """How the root lies in the camera's axes, in the body's own heading."""
    names = (f"{name}_forward_tilt", f"{name}_side_tilt", f"{name}_turn")
    return SphericalJoint(names, tuple(d for d in _skeleton().dofs if d.name in ROOT_DOFS[3:]), upward=True)


def _between(carrier: str, segment: str) -> tuple[Dof, ...]:
    """The degrees of freedom after the carrier's last up to the segment's last, outward."""
    skeleton = _skeleton()
    by_name = {dof.name: dof for dof in skeleton.dofs}
    chain: list[Dof] = []
    name: str | None = skeleton.links[segment]
    while name is not None and name != skeleton.links[carrier]:
        chain.append(by_name[name])
        name = by_name[name].parent
    return tuple(reversed(chain))


def hanging(joint: SphericalJoint) -> NDArray[np.float64]:
    """Rotation vector (3,) that takes the vertical to the left limb's bone at rest."""
    return np.array([0.0, 0.0, -joint.tilt])


@dataclass(frozen=True, slots=True)
class Angles:
    """Which angles a body has, and how they follow from its pose.

    Args:
        dof_names: Degrees of freedom (D,) of the poses.
        spherical: Joints with swing and twist; the whole body's turn is the first, if it moves.
        revolute: Joints of one degree of freedom.
        held: Values of degrees of freedom that do not move, radians; what is not named is zero.
        level: Rotation vector from the camera's axes to those in which the whole body's turn is given.
    """

    dof_names: tuple[str, ...]
    spherical: tuple[SphericalJoint, ...]
    revolute: tuple[RevoluteJoint, ...]
    held: Mapping[str, float]
    level: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def names(self) -> tuple[str, ...]:
        """What the angles (A,) are called; three of each spherical joint first, then the others."""
        return (
            *(name for joint in self.spherical for name in joint.names),
            *(joint.name for joint in self.revolute),
        )

    def measure(self, poses: Array) -> Array:
        """Angles (N, A) of poses (N, D), radians; of each the value nearest to zero."""
        parts = [self._spherical(joint, poses) for joint in self.spherical]
        revolute = [self._value(joint.dof, poses)[:, None] for joint in self.revolute]
        return np.concatenate([np.empty((len(poses), 0)), *parts, *revolute], axis=1)

    def near(self, angles: Array, reference: Array) -> Array:
        """The same angles (N, A), each on the turn nearest to `reference` (A,) or (N, A).

        A swing of s is also one of 360 degrees less s the other way about, and a turn is also one more.
        """
        near, reference = angles.copy(), np.broadcast_to(reference, angles.shape)
        for b, joint in enumerate(self.spherical):
            swing, twist = slice(3 * b, 3 * b + 2), 3 * b + 2
            near[:, swing] = nearest_swing(angles[:, swing], reference[:, swing], limb=not joint.upward)
            free = joint.dofs[0].name in ROOT_DOFS
            near[:, twist] = nearest_turn(angles[:, twist], reference[:, twist], np.inf if free else FARTHEST)
        first = 3 * len(self.spherical)
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
            hidden = [twist for twist, bend in self.levers.items() if frame[bend] < SHOWN_FROM_BEND]
            seen = np.delete(np.arange(len(frame)), hidden)
            last[seen] = frame[seen]
        return angles

    def _spherical(self, joint: SphericalJoint, poses: Array) -> Array:
        """Forward, sideways and twisting angle (N, 3) of one joint."""
        from scipy.spatial.transform import Rotation  # slow to load

        turned = self.rotation(joint, poses) * Rotation.from_rotvec(hanging(joint))
        swing, twist = swing_twist(turned)
        if joint.upward:
            return in_heading(swing, twist) if joint.dofs[0].name in ROOT_DOFS else upward(swing, twist)
        return np.stack([-swing[:, 0], -swing[:, 1], twist], axis=1)

    def rotation(self, joint: SphericalJoint, poses: Array) -> Rotation:
        """Of the moving segment in its carrier (N,); a right limb's as that of its mirror image."""
        from scipy.spatial.transform import Rotation  # slow to load

        of_body = joint.dofs[0].name in ROOT_DOFS
        total = Rotation.from_rotvec(np.tile(self.level if of_body else np.zeros(3), (len(poses), 1)))
        for dof in joint.dofs:
            if dof.name in self.dof_names or self.held.get(dof.name):
                axis = np.asarray(dof.axis) * (MIRROR if joint.mirrored else 1.0)
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
    revolute = tuple(RevoluteJoint(name, name) for name in turning)
    return Angles(model.dof_names, base, revolute, held or {}, level_turn(up))


def level_turn(up: Array | None) -> tuple[float, float, float]:
    """The rotation vector into the axes of a camera that is held level."""
    from scipy.spatial.transform import Rotation  # slow to load

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
