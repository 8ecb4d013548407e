"""The joint angles of a person: MPEG-4 names and numbers, ranges of motion, spreads around rest.

MPEG-4 (ISO/IEC 14496-2, Annex C) numbers 180 joint angles, left before right, and adds six parameters for the
body's root. This project follows the motion that a parameter means ("up and down rotation of the toe in the
sagittal plane"), with the signs of `coordinator.bodies.human.skeleton`, and moves the root by `root_tx` ...
`root_rz`.

Ranges of limbs: the means of American Academy of Orthopaedic Surgeons, "Joint Motion" (1965) and Boone &
Azen, "Normal range of motion of joints in male subjects", J. Bone Joint Surg. 61-A (1979), rounded outward by
a few degrees, because limits that are too tight prevent tracking; joints that are not in these sources have
small estimated ranges. Spine: about the sums over the regions of White & Panjabi, "Clinical Biomechanics
of the Spine", 2nd ed. (1990).

A single vertebra moves by a few degrees, but a tracker moves only one or two vertebrae, which represent their
region. So the range of each vertebra is that of all lumbar and thoracic joints together (including the pelvis
when a person bends down), or of the whole neck; a sum over many active vertebrae is not limited.
Shoulder and hip ranges are those of flexion, then abduction, then twisting, in this order: abduction reaches
180 degrees because an arm may be raised overhead by abduction alone.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import ROOT_DOFS

HUMAN = "human"

FINGERS = ("pinky", "ring", "middle", "index")
VERTEBRAE_UPWARD = tuple(
    f"{region}{n}" for region, count in (("vl", 5), ("vt", 12), ("vc", 7)) for n in range(count, 0, -1)
)

_LEG = (
    "hip_flexion", "hip_abduct", "hip_twisting", "knee_flexion", "knee_twisting", "ankle_flexion",
    "ankle_twisting", "subtalar_flexion", "midtarsal_twisting", "metatarsal_flexion",
)  # fmt: skip
_ARM = (
    "sternoclavicular_abduct", "sternoclavicular_rotate", "acromioclavicular_abduct",
    "acromioclavicular_rotate", "shoulder_flexion", "shoulder_abduct", "shoulder_twisting",
    "elbow_flexion", "elbow_twisting", "wrist_flexion", "wrist_pivot", "wrist_twisting",
)  # fmt: skip
_FINGER = ("0_flexion", "1_flexion", "1_pivot", "1_twisting", "2_flexion", "3_flexion")
_THUMB = ("1_flexion", "1_pivot", "1_twisting", "2_flexion", "3_flexion")
_HAND = (*(f"{finger}{motion}" for finger in FINGERS for motion in _FINGER), *(f"thumb{m}" for m in _THUMB))
_SPINE = tuple(
    f"{bone}_{motion}"
    for bone in ("skullbase", *reversed(VERTEBRAE_UPWARD))
    for motion in ("roll", "torsion", "tilt")
)


def _both_sides(names: tuple[str, ...]) -> list[str]:
    return [f"{side}_{name}" for name in names for side in "lr"]


JOINT_ANGLES: tuple[str, ...] = (
    "sacroiliac_tilt", "sacroiliac_torsion", "sacroiliac_roll",
    *_both_sides(_LEG), *_both_sides(_ARM), *_SPINE, *_both_sides(_HAND),
)  # fmt: skip
"""In the order of the standard's numbers, from 1."""

HUMAN_DOFS = (*ROOT_DOFS, *JOINT_ANGLES)

_TRUNK_RANGES = {"roll": (-45, 45), "torsion": (-50, 50), "tilt": (-35, 95)}
_NECK_RANGES = {"roll": (-45, 45), "torsion": (-80, 80), "tilt": (-65, 65)}
_SACROILIAC_RANGES = {"roll": (-20, 20), "torsion": (-20, 20), "tilt": (-30, 30)}

_LIMB_RANGES = {
    "hip_flexion": (-30, 130),
    "hip_abduct": (-30, 60),
    "hip_twisting": (-50, 50),
    "knee_flexion": (-5, 155),
    "knee_twisting": (-30, 30),
    "ankle_flexion": (-50, 30),
    "ankle_twisting": (-20, 20),
    "subtalar_flexion": (-20, 35),
    "midtarsal_twisting": (-15, 15),
    "metatarsal_flexion": (-45, 70),
    "sternoclavicular_abduct": (-10, 40),
    "sternoclavicular_rotate": (-20, 20),
    "acromioclavicular_abduct": (-10, 30),
    "acromioclavicular_rotate": (-20, 20),
    "shoulder_flexion": (-60, 180),
    "shoulder_abduct": (-50, 180),
    "shoulder_twisting": (-105, 95),
    "elbow_flexion": (-5, 155),
    "elbow_twisting": (-90, 90),
    "wrist_flexion": (-75, 80),
    "wrist_pivot": (-35, 25),
    "wrist_twisting": (-10, 10),
}

_FINGER_RANGES = {
    "0_flexion": (-5, 15),
    "1_flexion": (-30, 90),
    "1_pivot": (-20, 20),
    "1_twisting": (-10, 10),
    "2_flexion": (0, 105),
    "3_flexion": (-5, 85),
}

_THUMB_RANGES = {
    "1_flexion": (-30, 30),
    "1_pivot": (-20, 60),
    "1_twisting": (-20, 40),
    "2_flexion": (-10, 60),
    "3_flexion": (-15, 80),
}

_REST_SPREADS = {"shoulder": 1.5, "elbow": 1.5, "hip": 0.625, "knee": 0.8125, "neck": 0.25}
"""Values other than 1, for a `pose_deviation` of 1.6 rad: arms are free, legs are mostly straight, and the
pose of the head is barely visible (0.5 gives the same result for the skinned people).

Arms: from the paper's arm without noise, whose angles a narrower prior changes by 0.4 degrees. Hips and
knees: from subjects 1 and 2 of UTD-MHAD sitting down, standing up, lunging and squatting, at 10 frames per
second.
"""


def rest_spread(dof: str) -> float:
    """Standard deviation of an angle in the rest prior, in units of `pose_deviation`."""
    joint = _parts(dof)[1]
    return _REST_SPREADS.get("neck" if _is_in_neck(joint) else joint, 1.0)


def joint_range(dof: str) -> NDArray[np.float64]:
    """Lower and upper limit (2,) in radians, or in metres for the root; infinite if free."""
    side, joint, motion = _parts(dof)
    if joint == "root":
        return np.array([-np.inf, np.inf])
    if side:
        return np.radians(_limb_degrees(joint, motion))
    if joint == "sacroiliac":
        return np.radians(_SACROILIAC_RANGES[motion])
    return np.radians((_NECK_RANGES if _is_in_neck(joint) else _TRUNK_RANGES)[motion])


def _parts(dof: str) -> tuple[str, str, str]:
    """Side (empty for the middle), joint and motion in the name of a degree of freedom."""
    side = dof[0] if dof.startswith(("l_", "r_")) else ""
    joint, _, motion = dof.removeprefix(f"{side}_").partition("_")
    return side, joint, motion


def _is_in_neck(joint: str) -> bool:
    return joint.startswith(("vc", "skull"))


def _limb_degrees(joint: str, motion: str) -> tuple[int, int]:
    if f"{joint}_{motion}" in _LIMB_RANGES:
        return _LIMB_RANGES[f"{joint}_{motion}"]
    finger, number = joint[:-1], joint[-1]
    return (_THUMB_RANGES if finger == "thumb" else _FINGER_RANGES)[f"{number}_{motion}"]
