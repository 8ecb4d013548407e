"""Joint centres of the human template and the table of its degrees of freedom.

Rest pose: upright, facing the camera, arms at the sides, palms towards the thighs. The arms hang
`ARM_TILT` off the vertical so that they clear the trunk, and all angles are zero there. Coordinates are
those of `common.body`: x to the person's left, y down, z to the person's back, the root between the hip
joints at the origin.

Signs, the same on both sides of the body:

- flexion of shoulder and hip moves the limb forward, of the elbow the hand forward, of the knee the heel
  backward, of the ankle and the toes the foot up, of wrist and fingers the hand towards the palm, of the
  subtalar joint the sole inward;
- abduct moves the limb (or the shoulder, for the clavicle) out and up, sideways;
- twisting and the clavicle's rotate turn inward: what is in front moves to the body's midline;
- pivot moves the hand or finger to the side of the thumb; the thumb's away from the palm;
- tilt bends forward, torsion turns to the person's left, roll leans to the person's right.

The legs hang off the root, the spine stands on the sacroiliac joint, so bending the waist leaves the legs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS, ROTATION, TRANSLATION
from coordinator.models.measures import Measures
from coordinator.models.mpeg4 import FINGERS, VERTEBRAE_UPWARD

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

ARM_TILT = np.radians(9.0)

LEFT, DOWN, BACK = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
RIGHT, UP, FRONT = (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)

_SPINE_MOTIONS = {"roll": FRONT, "torsion": UP, "tilt": LEFT}
_THUMB_DIRECTION = (0.0, 0.8, -0.6)
_THUMB_NORMAL = (0.0, 0.6, 0.8)

# Left side: bone, its joint, and the axis of each motion. The right side is its mirror image.
_LEG = (
    ("thigh", "hip", {"hip_flexion": RIGHT, "hip_abduct": FRONT, "hip_twisting": DOWN}),
    ("shank", "knee", {"knee_flexion": LEFT, "knee_twisting": DOWN}),
    ("talus", "ankle", {"ankle_flexion": RIGHT, "ankle_twisting": DOWN}),
    ("heel", "subtalar", {"subtalar_flexion": BACK}),
    ("foot", "midtarsal", {"midtarsal_twisting": BACK}),
    ("toes", "metatarsal", {"metatarsal_flexion": RIGHT}),
)
_ARM = (
    ("clavicle", "sternoclavicular", {"sternoclavicular_abduct": FRONT, "sternoclavicular_rotate": DOWN}),
    ("scapula", "acromioclavicular", {"acromioclavicular_abduct": FRONT, "acromioclavicular_rotate": DOWN}),
    (
        "upper_arm",
        "shoulder",
        {"shoulder_flexion": RIGHT, "shoulder_abduct": FRONT, "shoulder_twisting": DOWN},
    ),
    ("forearm", "elbow", {"elbow_flexion": RIGHT, "elbow_twisting": DOWN}),
    ("hand", "wrist", {"wrist_flexion": BACK, "wrist_pivot": RIGHT, "wrist_twisting": DOWN}),
)


@dataclass(frozen=True)
class Dof:
    """One degree of freedom: its parent's name, its axis, and the joint through which the axis goes."""

    name: str
    kind: int
    parent: str | None
    axis: Vector
    joint: str


@dataclass(frozen=True)
class Skeleton:
    """Joint centres (3,) by name, degrees of freedom in chain order, links with their last one."""

    joints: dict[str, Array]
    dofs: tuple[Dof, ...]
    links: dict[str, str]


def build_skeleton(measures: Measures) -> Skeleton:
    """Joints, degrees of freedom and links for these measures."""
    joints = place_joints(measures)
    dofs: list[Dof] = []
    links: dict[str, str] = {}
    for link, parent, joint, axes, kind in _bones():
        above = links.get(parent) if parent else None
        for name, axis in axes.items():
            dofs.append(Dof(name, kind, above, axis, joint))
            above = name
        links[link] = dofs[-1].name
    return Skeleton(joints, tuple(dofs), links)


Bone = tuple[str, str | None, str, dict[str, Vector], int]


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
        yield from _limb(side, "vt1", _ARM)
        yield from _fingers(side)
        yield from _limb(side, "pelvis", _LEG)


def _limb(side: str, parent: str, bones: tuple[tuple[str, str, dict[str, Vector]], ...]) -> Iterator[Bone]:
    for bone, joint, axes in bones:
        sided = {f"{side}_{name}": _sided(side, _hang(joint, axis)) for name, axis in axes.items()}
        yield f"{side}_{bone}", parent, f"{side}_{joint}", sided, ROTATION
        parent = f"{side}_{bone}"


def _fingers(side: str) -> Iterator[Bone]:
    for finger in FINGERS:
        parent = f"{side}_hand"
        first = {"1_flexion": BACK, "1_pivot": RIGHT, "1_twisting": DOWN}
        for n, axes in enumerate(({"0_flexion": BACK}, first, {"2_flexion": BACK}, {"3_flexion": BACK})):
            yield _phalanx(side, parent, finger, n, axes)
            parent = f"{side}_{finger}{n}"
    parent = f"{side}_hand"
    first = {"1_flexion": LEFT, "1_pivot": _THUMB_NORMAL, "1_twisting": _THUMB_DIRECTION}
    for n, axes in enumerate((first, {"2_flexion": LEFT}, {"3_flexion": LEFT}), start=1):
        yield _phalanx(side, parent, "thumb", n, axes)
        parent = f"{side}_thumb{n}"


def _phalanx(side: str, parent: str, finger: str, n: int, axes: dict[str, Vector]) -> Bone:
    name = f"{side}_{finger}{n}"
    sided = {f"{side}_{finger}{motion}": _sided(side, tilt(axis)) for motion, axis in axes.items()}
    return name, parent, name, sided, ROTATION


def _hang(joint: str, axis: Vector) -> Vector:
    """Arm axes are tilted with the hanging arm; the clavicle's and the legs' are not."""
    return tilt(axis) if joint in ("shoulder", "elbow", "wrist") else axis


def tilt(vector: Vector) -> Vector:
    """A vector of the vertical left arm as the hanging arm has it."""
    c, s = float(np.cos(ARM_TILT)), float(np.sin(ARM_TILT))
    x, y, z = vector
    return c * x + s * y, c * y - s * x, z


def _sided(side: str, axis: Vector) -> Vector:
    """The axis of a left joint, or of its mirror image on the right."""
    return axis if side == "l" else (axis[0], -axis[1], -axis[2])


def place_joints(measures: Measures) -> dict[str, Array]:
    """Joint centres (3,) in metres, rest frame."""
    spine = _spine(measures)
    head = spine["skullbase"] + np.array([0.0, -0.024, -0.004]) * measures.stature
    joints = {"pelvis": np.zeros(3), **spine, "head": head}
    left = {**_leg(measures), **_arm(measures, joints["vc7"])}
    for name, point in left.items():
        joints[f"l_{name}"] = point
        joints[f"r_{name}"] = point * (-1.0, 1.0, 1.0)
    return joints


def _spine(measures: Measures) -> dict[str, Array]:
    """Vertebra joints along a curve through known levels, up from the hips (fractions of the trunk)."""
    t = measures.trunk
    known = np.array([0.0, 5.0, 11.0, 17.0, 24.0])  # vl5, vt12, vt6, vc7, skullbase
    height = np.interp(np.arange(25), known, np.array([0.20, 0.585, 0.89, 1.165, 1.40]) * t)
    depth = np.interp(np.arange(25), known, np.array([0.06, 0.08, 0.12, 0.06, 0.0]) * t)
    names = (*VERTEBRAE_UPWARD, "skullbase")
    spine = {name: np.array([0.0, -height[i], depth[i]]) for i, name in enumerate(names)}
    return {"sacroiliac": np.array([0.0, -0.10 * t, 0.09 * t]), **spine}


def _leg(measures: Measures) -> dict[str, Array]:
    x = 0.5 * measures.hip_width
    knee = measures.thigh
    ankle = knee + measures.shank
    sole = ankle + measures.ankle_height
    lift = measures.ankle_height
    foot = measures.foot
    return {
        "hip": np.array([x, 0.0, 0.0]),
        "knee": np.array([x, knee, 0.005 * measures.stature]),
        "ankle": np.array([x, ankle, 0.014 * measures.stature]),
        "subtalar": np.array([x, sole - 0.6 * lift, 0.014 * measures.stature]),
        "midtarsal": np.array([x, sole - 0.55 * lift, 0.014 * measures.stature - 0.17 * foot]),
        "metatarsal": np.array([x, sole - 0.25 * lift, 0.014 * measures.stature - 0.46 * foot]),
    }


def _arm(measures: Measures, neck: Array) -> dict[str, Array]:
    x = 0.5 * measures.shoulder_width
    shoulder = np.array([x, -measures.trunk, 0.012 * measures.stature])
    elbow = shoulder + measures.upper_arm * np.array(tilt(DOWN))
    wrist = elbow + measures.forearm * np.array(tilt(DOWN))
    joints = {
        "sternoclavicular": np.array([0.1 * x, -1.04 * measures.trunk, -0.025 * measures.stature]),
        "acromioclavicular": shoulder + np.array([-0.02, -0.022, 0.0]) * measures.stature,
        "shoulder": shoulder,
        "elbow": elbow,
        "wrist": wrist,
    }
    return {**joints, **_hand(measures, wrist)}


def _hand(measures: Measures, wrist: Array) -> dict[str, Array]:
    """Finger joints, on lines down the hanging hand; the index finger is in front."""
    joints = {}
    for i, finger in enumerate(FINGERS):
        front = (i - 1.5) * 0.11
        for n, along in enumerate((0.12, 0.47, 0.70, 0.86)):
            at = np.array(tilt((0.0, along, -front * min(1.0, 0.5 + n)))) * measures.hand
            joints[f"{finger}{n}"] = wrist + at
    base = np.array(tilt((0.0, 0.13, -0.12))) * measures.hand
    along_thumb = np.array(tilt(_THUMB_DIRECTION)) * measures.hand
    for n, along in ((1, 0.0), (2, 0.24), (3, 0.40)):
        joints[f"thumb{n}"] = wrist + base + along * along_thumb
    return joints
