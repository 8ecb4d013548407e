"""The body animation parameters of MPEG-4 (ISO/IEC 14496-2, Annex C) by number and name.

The standard numbers 180 joint angles, left before right, and adds six for the body's root. This project
follows the motion that a parameter means ("up and down rotation of the toe in the sagittal plane"), with the
signs of `coordinator.bodies.human.skeleton`, and moves the root by `root_tx` ... `root_rz`;
`coordinator.exports.bap` writes the standard's own signs and root.
"""

from __future__ import annotations

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


def _both_sides(names: tuple[str, ...]) -> list[str]:
    return [f"{side}_{name}" for name in names for side in "lr"]


def _spine() -> list[str]:
    downward = ("skullbase", *reversed(VERTEBRAE_UPWARD))
    return [f"{bone}_{motion}" for bone in downward for motion in ("roll", "torsion", "tilt")]


def _hand() -> tuple[str, ...]:
    fingers = [f"{finger}{motion}" for finger in FINGERS for motion in _FINGER]
    return (*fingers, *(f"thumb{motion}" for motion in _THUMB))


JOINT_ANGLES: tuple[str, ...] = (
    "sacroiliac_tilt", "sacroiliac_torsion", "sacroiliac_roll",
    *_both_sides(_LEG), *_both_sides(_ARM), *_spine(), *_both_sides(_hand()),
)  # fmt: skip

HUMAN_DOFS = (*ROOT_DOFS, *JOINT_ANGLES)

BODY_ANIMATION_PARAMETERS: dict[int, str] = dict(enumerate(JOINT_ANGLES, start=1))
"""Parameter number -> degree of freedom, for the joint angles, 1-180."""

ROOT_PARAMETERS: dict[int, str] = dict(
    enumerate(
        ("tr_vertical", "tr_lateral", "tr_frontal", "rt_body_turn", "rt_body_roll", "rt_body_tilt"), start=181
    )
)
"""Parameter number -> the standard's name, for the root, 181-186."""
