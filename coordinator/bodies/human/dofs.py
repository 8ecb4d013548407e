"""The joint angles of a person: MPEG-4 names and numbers, ranges of motion, spreads around rest.

MPEG-4 (ISO/IEC 14496-2, Annex C) numbers 180 joint angles, left before right, and adds six parameters for the
body's root. This project follows the motion that a parameter means ("up and down rotation of the toe in the
sagittal plane"), with the signs of `gepf.coordinator.bodies.human.skeleton`, and moves the root by
`root_tx` ... `root_rz`.

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

from gepf.common.arrays import Array
from gepf.common.body import ROOT_DOFS

HUMAN = "human"

FINGERS = ("pinky", "ring", "middle", "index")
VERTEBRAE_UPWARD = tuple(
    f"{region}{n}" for region, count in (("vl", 5), ("vt", 12), ("vc", 7)) for n in range(count, 0, -1)
)

_Ranges = dict[str, tuple[float, float]]  # degrees

_LIMB_RANGES: _Ranges = {
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

_FINGER_RANGES: _Ranges = {
    "0_flexion": (-5, 15),
    "1_flexion": (-30, 90),
    "1_pivot": (-20, 20),
    "1_twisting": (-10, 10),
    "2_flexion": (0, 105),
    "3_flexion": (-5, 85),
}

_THUMB_RANGES: _Ranges = {
    "1_flexion": (-30, 30),
    "1_pivot": (-20, 60),
    "1_twisting": (-20, 40),
    "2_flexion": (-10, 60),
    "3_flexion": (-15, 80),
}

_SACROILIAC_RANGES: _Ranges = {"tilt": (-30, 30), "torsion": (-20, 20), "roll": (-20, 20)}
_NECK_RANGES: _Ranges = {"roll": (-45, 45), "torsion": (-80, 80), "tilt": (-65, 65)}
_TRUNK_RANGES: _Ranges = {"roll": (-45, 45), "torsion": (-50, 50), "tilt": (-35, 95)}


def _of_each(joints: tuple[str, ...], ranges: _Ranges) -> _Ranges:
    return {f"{joint}{motion}": limits for joint in joints for motion, limits in ranges.items()}


def _both_sides(ranges: _Ranges) -> _Ranges:
    return {f"{side}_{name}": limits for name, limits in ranges.items() for side in "lr"}


_NECK = ("skullbase_", *(f"{bone}_" for bone in reversed(VERTEBRAE_UPWARD) if bone.startswith("vc")))
_TRUNK = tuple(f"{bone}_" for bone in reversed(VERTEBRAE_UPWARD) if not bone.startswith("vc"))
_RANGES = {
    **_of_each(("sacroiliac_",), _SACROILIAC_RANGES),
    **_both_sides(_LIMB_RANGES),
    **_of_each(_NECK, _NECK_RANGES),
    **_of_each(_TRUNK, _TRUNK_RANGES),
    **_both_sides({**_of_each(FINGERS, _FINGER_RANGES), **_of_each(("thumb",), _THUMB_RANGES)}),
}

JOINT_ANGLES = tuple(_RANGES)
"""In the order of the standard's numbers, from 1."""

HUMAN_DOFS = (*ROOT_DOFS, *JOINT_ANGLES)

_REST_SPREADS = {"shoulder": 1.5, "elbow": 1.5, "hip": 0.625, "knee": 0.8125, "neck": 0.25}
"""Values other than 1, for a `pose_deviation` of 1.6 rad: arms are free, legs are mostly straight, and the
pose of the head is barely visible (0.5 gives the same result for the skinned people).

Arms: from the paper's arm without noise, whose angles a narrower prior changes by 0.4 degrees. Hips and
knees: from subjects 1 and 2 of UTD-MHAD sitting down, standing up, lunging and squatting, at 6.3 frames per
second.
"""


def rest_spread(dof: str) -> float:
    """Standard deviation of an angle in the rest prior, in units of `pose_deviation`."""
    if dof.startswith(_NECK):
        return _REST_SPREADS["neck"]
    return _REST_SPREADS.get(dof.partition("_")[2].partition("_")[0], 1.0)


def joint_range(dof: str) -> Array:
    """Lower and upper limit (2,) in radians, or in metres for the root; infinite if free."""
    return np.radians(_RANGES.get(dof, (-np.inf, np.inf)))
