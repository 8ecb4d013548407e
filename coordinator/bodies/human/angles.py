"""Anatomical angles of people: flexion, abduction and rotation, with plain names.

Angles are zero with arms straight down along the trunk (the template's arms differ from that by
`REST.arm_tilt`, so its rest pose has this abduction), legs and spine straight.

Signs are alike on both sides: flexion is forward (knee: the heel back), abduction away from the body,
rotation inward; trunk, neck and pelvis bend forward, lean to the person's right and turn to the left.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from gepf.common.arrays import Array
from gepf.common.body import ROTATION
from gepf.coordinator.bodies.angles import Angles, RevoluteJoint, SphericalJoint, Turn, level_turn, whole_body
from gepf.coordinator.bodies.human.skeleton import REST, Dof, build_skeleton

SIDES = {"r": "right", "l": "left"}
NECK_FLEXION = "neck_flexion"

ANGLE_MISFIT = float(np.radians(5.0))
"""Least error of a person's angles, if joints are correct and all hypotheses agree. Together with the
deviation of the joints and twice the spread of the hypotheses, 80 % of elbow, knee, shoulder and hip angles
of people with exact truth are within one deviation, 98 % within two."""

_LIMB_BONES = {
    # joint: carrier, moving segment, angle of the bone to the vertical at rest
    "shoulder": ("vt1", "{side}_upper_arm", REST.arm_tilt),
    "hip": ("pelvis", "{side}_thigh", 0.0),
}
_WORDS = {"twisting": "rotation", "rotate": "rotation", "abduct": "abduction", "pivot": "deviation"}
_OWN_NAMES = {
    "elbow_twisting": "forearm_pronation",
    "subtalar_flexion": "subtalar_inversion",
    "metatarsal_flexion": "toes_flexion",
}

_OF_LIMBS = {
    # angle: the joint whose position shows it, and the one about which that turns
    "shoulder_flexion": ("elbow", "shoulder"),
    "shoulder_abduction": ("elbow", "shoulder"),
    "shoulder_rotation": ("wrist", "elbow"),
    "elbow_flexion": ("wrist", "elbow"),
    "hip_flexion": ("knee", "hip"),
    "hip_abduction": ("knee", "hip"),
    "hip_rotation": ("ankle", "knee"),
    "knee_flexion": ("ankle", "knee"),
}
SHOWN_BY = {NECK_FLEXION: ("head", "neck")} | {
    f"{side}_{angle}": (f"{side}_{end}", f"{side}_{pivot}")
    for side in SIDES.values()
    for angle, (end, pivot) in _OF_LIMBS.items()
}
BENDS = {f"{side}_shoulder_rotation": f"{side}_elbow_flexion" for side in SIDES.values()}


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


def _between(carrier: str, segment: str) -> tuple[Turn, ...]:
    """The degrees of freedom after the carrier's last up to the segment's last, outward."""
    skeleton = build_skeleton()
    by_name = {dof.name: dof for dof in skeleton.dofs}
    chain: list[Dof] = []
    name: str | None = skeleton.links[segment]
    while name is not None and name != skeleton.links[carrier]:
        chain.append(by_name[name])
        name = by_name[name].parent
    return tuple(Turn(dof.name, dof.axis) for dof in reversed(chain))


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
        ANGLE_MISFIT,
        BENDS,
        SHOWN_BY,
    )
