"""The table of a person's degrees of freedom.

Rest pose: upright, facing the camera, arms at the sides, palms towards the thighs. The arms differ from the
vertical by `REST.arm_tilt`, so that they do not touch an average trunk. All angles are zero there for any
girth, so that angles of different people can be compared. Coordinates are those of `gepf.common.body`: x to
the person's left, y down, z to the person's back, the root between the hip joints at the origin.

Signs, the same on both sides of the body:

- flexion of shoulder and hip moves the limb forward, of the elbow the hand forward, of the knee the heel
  backward, of the ankle and the toes the foot up, of wrist and fingers the hand towards the palm, of the
  subtalar joint the sole inward;
- abduct moves the limb (or the shoulder, for the clavicle) out and up, sideways;
- twisting and the clavicle's rotate turn inward: what is in front moves to the body's midline;
- pivot moves the hand or finger to the side of the thumb; the thumb's away from the palm;
- tilt bends forward, torsion turns to the person's left, roll leans to the person's right.

The legs are children of the root and the spine is a child of the sacroiliac joint, so bending the waist does
not move the legs. In the standard the spine is a child of the root and the legs of the sacroiliac joint.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from gepf.common.body import ROOT_DOFS, ROTATION, TRANSLATION
from gepf.coordinator.bodies.human.dofs import FINGERS, VERTEBRAE_UPWARD

Vector = tuple[float, float, float]
Motions = dict[str, Vector]
Bone = tuple[str, str | None, str, Motions, int]

LEFT, DOWN, BACK = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
RIGHT, UP, FRONT = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)


class RestPose(NamedTuple):
    """How arms and thumbs differ from vertical limbs at rest."""

    arm_tilt: float = np.radians(11.0)  #: angle to the vertical, radians
    thumb_direction: Vector = (0.0, 0.8, -0.6)  #: of a vertical left arm


REST = RestPose()

_SPINE_MOTIONS = {"roll": FRONT, "torsion": UP, "tilt": LEFT}
_FINGER = {
    0: {"flexion": BACK},
    1: {"flexion": BACK, "pivot": RIGHT, "twisting": DOWN},
    2: {"flexion": BACK},
    3: {"flexion": BACK},
}
_THUMB = {
    1: {"flexion": LEFT, "pivot": (0.0, 0.6, 0.8), "twisting": REST.thumb_direction},
    2: {"flexion": LEFT},
    3: {"flexion": LEFT},
}

# Left side: bone, its joint, and the axis of each motion. The right side is its mirror image.
_LEG = {
    ("thigh", "hip"): {"flexion": RIGHT, "abduct": FRONT, "twisting": DOWN},
    ("shank", "knee"): {"flexion": LEFT, "twisting": DOWN},
    ("talus", "ankle"): {"flexion": RIGHT, "twisting": DOWN},
    ("heel", "subtalar"): {"flexion": BACK},
    ("foot", "midtarsal"): {"twisting": BACK},
    ("toes", "metatarsal"): {"flexion": RIGHT},
}
_GIRDLE = {
    ("clavicle", "sternoclavicular"): {"abduct": FRONT, "rotate": DOWN},
    ("scapula", "acromioclavicular"): {"abduct": FRONT, "rotate": DOWN},
}
_ARM = {
    ("upper_arm", "shoulder"): {"flexion": RIGHT, "abduct": FRONT, "twisting": DOWN},
    ("forearm", "elbow"): {"flexion": RIGHT, "twisting": DOWN},
    ("hand", "wrist"): {"flexion": BACK, "pivot": RIGHT, "twisting": DOWN},
}


@dataclass(frozen=True)
class Dof:
    """One degree of freedom: name of its parent, axis, and joint on the axis."""

    name: str
    kind: int
    parent: str | None
    axis: Vector
    joint: str


@dataclass(frozen=True)
class Skeleton:
    """Degrees of freedom in chain order, and for each link the last one that moves it."""

    dofs: tuple[Dof, ...]
    links: dict[str, str]


@cache
def build_skeleton() -> Skeleton:
    """The degrees of freedom and links of all people."""
    dofs: list[Dof] = []
    links: dict[str, str] = {}
    for link, parent, joint, axes, kind in _bones():
        above = links.get(parent) if parent else None
        for name, axis in axes.items():
            dofs.append(Dof(name, kind, above, axis, joint))
            above = name
        links[link] = dofs[-1].name
    return Skeleton(tuple(dofs), links)


def _bones() -> Iterator[Bone]:
    """Link, parent link, joint, axes by degree of freedom, and kind; parents before children."""
    axes = (LEFT, DOWN, BACK)
    yield "root", None, "pelvis", dict(zip(ROOT_DOFS[:3], axes, strict=True)), TRANSLATION
    yield "pelvis", "root", "pelvis", dict(zip(ROOT_DOFS[3:], axes, strict=True)), ROTATION
    sacroiliac = {f"sacroiliac_{m}": _SPINE_MOTIONS[m] for m in ("tilt", "torsion", "roll")}
    yield "sacrum", "pelvis", "sacroiliac", sacroiliac, ROTATION
    below = "sacrum"
    for bone in (*VERTEBRAE_UPWARD, "skull"):
        stem = "skullbase" if bone == "skull" else bone
        yield bone, below, stem, {f"{stem}_{m}": axis for m, axis in _SPINE_MOTIONS.items()}, ROTATION
        below = bone
    for side in "lr":
        yield from _limb(side, "vt1", _GIRDLE, 0.0)
        yield from _limb(side, f"{side}_scapula", _ARM, REST.arm_tilt)
        for finger in (*FINGERS, "thumb"):
            parts = _THUMB if finger == "thumb" else _FINGER
            bones = {(f"{finger}{n}", f"{finger}{n}"): motions for n, motions in parts.items()}
            yield from _limb(side, f"{side}_hand", bones, REST.arm_tilt)
        yield from _limb(side, "pelvis", _LEG, 0.0)


def _limb(side: str, parent: str, bones: dict[tuple[str, str], Motions], tilt: float) -> Iterator[Bone]:
    for (bone, joint), motions in bones.items():
        yield f"{side}_{bone}", parent, f"{side}_{joint}", _axes(side, joint, motions, tilt), ROTATION
        parent = f"{side}_{bone}"


def _axes(side: str, joint: str, motions: Motions, tilt: float) -> Motions:
    """Axis of each degree of freedom of a joint of either side, in a tilted limb."""
    sign = 1.0 if side == "l" else -1.0
    turned = {motion: tilted(axis, tilt) for motion, axis in motions.items()}
    return {f"{side}_{joint}_{motion}": (x, sign * y, sign * z) for motion, (x, y, z) in turned.items()}


def tilted(vector: Vector, angle: float) -> Vector:
    """A vector of a vertical left limb after raising it sideways by `angle`."""
    c, s = float(np.cos(angle)), float(np.sin(angle))
    x, y, z = vector
    return c * x + s * y, c * y - s * x, z
