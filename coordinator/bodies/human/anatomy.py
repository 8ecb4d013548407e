"""The joints of a person as anatomy names them, and which degrees of freedom move each.

A joint is the motion of one segment in the one that carries it. Three angles describe it: two of the swing of
the moving bone and one of the twist about it. They are zero where the bone lies along the carrier's axis
and the hinge axes run from side to side: arms straight down along the trunk (the template's arms hang
`ARM_TILT` off it, so its rest pose has that much abduction), legs and spine straight.

Signs mean the same on both sides: flexion moves forward (knee: the heel back), abduction away from the body,
rotation inward; the trunk, neck and pelvis bend forward, lean to the person's right and turn to the left.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, ROTATION
from coordinator.bodies.human.measures import Measures
from coordinator.bodies.human.skeleton import ARM_TILT, Dof, Skeleton, build_skeleton

SIDES = {"r": "right", "l": "left"}

_LIMBS = {
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
class BallJoint:
    """A joint with swing and twist.

    names: of the forward, the sideways and the twisting angle. dofs: what moves it, from the carrier outward.
    sideways: sign of the sideways angle about the axis to the front. tilt: of the bone at rest, radians.
    """

    names: tuple[str, str, str]
    dofs: tuple[Dof, ...]
    mirrored: bool = False
    upward: bool = False
    tilt: float = 0.0


@dataclass(frozen=True, slots=True)
class Hinge:
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
    """Any person's: axes and order are everybody's."""
    return build_skeleton(Measures.of(1.75))


@cache
def anatomical_joints() -> tuple[tuple[BallJoint, ...], tuple[Hinge, ...]]:
    """All joints of the template; each degree of freedom but the root's translations belongs to one."""
    balls = tuple(_balls())
    within = {dof.name for ball in balls for dof in ball.dofs}
    hinges = [
        Hinge(plain_name(dof.name), dof.name)
        for dof in _skeleton().dofs
        if dof.kind == ROTATION and dof.name not in within
    ]
    return balls, tuple(hinges)


def _balls() -> Iterator[BallJoint]:
    yield whole_body("pelvis")
    for name, carrier, segment in (("trunk", "pelvis", "vt1"), ("neck", "vt1", "skull")):
        names = (f"{name}_flexion", f"{name}_side_bending", f"{name}_rotation")
        yield BallJoint(names, _between(carrier, segment), upward=True)
    for side, word in SIDES.items():
        for joint, (carrier, segment, tilt) in _LIMBS.items():
            names = (f"{word}_{joint}_flexion", f"{word}_{joint}_abduction", f"{word}_{joint}_rotation")
            chain = _between(carrier, segment.format(side=side))
            yield BallJoint(names, chain, mirrored=side == "r", tilt=tilt)


def whole_body(name: str) -> BallJoint:
    """How the root lies in the camera's axes, in the body's own heading."""
    names = (f"{name}_forward_tilt", f"{name}_side_tilt", f"{name}_turn")
    return BallJoint(names, tuple(d for d in _skeleton().dofs if d.name in ROOT_DOFS[3:]), upward=True)


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


def hanging(joint: BallJoint) -> NDArray[np.float64]:
    """Rotation vector (3,) that takes the vertical to the left limb's bone at rest."""
    return np.array([0.0, 0.0, -joint.tilt])
