"""Joint centres of a person at rest, from segment lengths; all as shares of stature.

Coordinates are those of `gepf.coordinator.bodies.human.skeleton`. Where each centre lies in the body:

- hip: Harrington et al., "Prediction of the hip joint centre ...", J. Biomech. 40 (2007), for the mean pelvis
  of ANSUR II;
- knee, elbow: between the epicondyles; ankle: between the malleoli; wrist: between the styloids (the
  recommendations of the ISB: Wu et al., J. Biomech. 35 (2002) and 38 (2005));
- shoulder: the point about which the arm rotates while clavicle and scapula are held. They move the joint
  itself, the glenohumeral one, with the arm; it is `shoulder_below` down the arm from that point;
- vertebrae: along the curve of the spine; head: the middle of the skull, `head_centre` from its base.

Lengths of an adult lie between the segments of Drillis & Contini (1966; in Winter, "Biomechanics and Motor
Control of Human Movement", 4th ed. 2009, fig. 4.1), which end at landmarks on the skin, and the distances
between joint centres of de Leva, "Adjustments to Zatsiorsky-Seluyanov's segment inertia parameters", J.
Biomech. 29 (1996). Those of children differ from them as MakeHuman's children differ from its adults.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from gepf.common.arrays import Array
from gepf.coordinator.bodies.human.dofs import FINGERS, VERTEBRAE_UPWARD
from gepf.coordinator.bodies.human.skeleton import DOWN, REST, tilted

Joints = dict[str, Array]

ADULT = {
    "upper_arm": 0.166,
    "forearm": 0.148,
    "hand": 0.108,
    "thigh": 0.243,
    "shank": 0.247,
    "ankle_height": 0.040,
    "foot": 0.152,
    "trunk": 0.276,
    "shoulder_width": 0.206,
    "hip_width": 0.106,
}
"""Without clothes; the surface is fitted to these joints."""
CLOTHED = {**ADULT, "thigh": 0.2394, "shank": 0.2371, "ankle_height": 0.0490}
"""Joints of a person in clothes: shoes and hair make legs a smaller share of stature, and ankles higher.

Chosen on subjects 1 and 2 of UTD-MHAD and the two skinned people, between 0.96 and 1 of `ADULT`.
"""


class JointPlaces(msgspec.Struct, frozen=True):
    """Where joint centres are besides the ends of segments, as shares of stature.

    `back` is behind the hips, where a person stands upright: the zero of all angles.
    """

    shoulder_below: float = 0.020  #: for subjects 1 and 2 of UTD-MHAD and the two skinned people 2 to 5 cm
    head_centre: tuple[float, float, float] = (0.0, -0.040, 0.012)  #: from the skull's base, by the same data
    shoulder_back: float = 0.012
    knee_back: float = 0.005
    ankle_back: float = 0.014


PLACES = JointPlaces()


def place_joints(lengths: Mapping[str, float]) -> Joints:
    """Joint centres (3,) of a person with these lengths, rest frame."""
    spine = _spine(lengths["trunk"])
    joints = {"pelvis": np.zeros(3), **spine, "head": spine["skullbase"] + np.array(PLACES.head_centre)}
    for name, point in {**_leg(lengths), **_arm(lengths)}.items():
        joints[f"l_{name}"] = point
        joints[f"r_{name}"] = point * (-1.0, 1.0, 1.0)
    return joints


def _spine(trunk: float) -> Joints:
    """Vertebra joints along a curve through known levels, up from the hips (fractions of the trunk)."""
    known = np.array([0.0, 5.0, 11.0, 17.0, 24.0])  # vl5, vt12, vt6, vc7, skullbase
    height = np.interp(np.arange(25), known, np.array([0.20, 0.585, 0.89, 1.165, 1.40]) * trunk)
    depth = np.interp(np.arange(25), known, np.array([0.06, 0.08, 0.12, 0.06, 0.0]) * trunk)
    names = (*VERTEBRAE_UPWARD, "skullbase")
    spine = {name: np.array([0.0, -height[i], depth[i]]) for i, name in enumerate(names)}
    return {"sacroiliac": np.array([0.0, -0.10, 0.09]) * trunk, **spine}


def _leg(lengths: Mapping[str, float]) -> Joints:
    x, knee, foot = 0.5 * lengths["hip_width"], lengths["thigh"], lengths["foot"]
    lift = lengths["ankle_height"]
    ankle = knee + lengths["shank"]
    sole = ankle + lift
    return {
        "hip": np.array([x, 0.0, 0.0]),
        "knee": np.array([x, knee, PLACES.knee_back]),
        "ankle": np.array([x, ankle, PLACES.ankle_back]),
        "subtalar": np.array([x, sole - 0.6 * lift, PLACES.ankle_back]),
        "midtarsal": np.array([x, sole - 0.55 * lift, PLACES.ankle_back - 0.17 * foot]),
        "metatarsal": np.array([x, sole - 0.25 * lift, PLACES.ankle_back - 0.46 * foot]),
    }


def _arm(lengths: Mapping[str, float]) -> Joints:
    x, trunk = 0.5 * lengths["shoulder_width"], lengths["trunk"]
    shoulder = np.array([x, -trunk, PLACES.shoulder_back])
    down = np.array(tilted(DOWN, REST.arm_tilt))
    wrist = shoulder + (lengths["upper_arm"] + lengths["forearm"]) * down
    return {
        "sternoclavicular": np.array([0.1 * x, -1.04 * trunk, -0.025]),
        "acromioclavicular": shoulder + np.array([-0.02, -0.022, 0.0]),
        "shoulder": shoulder,
        "glenohumeral": shoulder + PLACES.shoulder_below * down,
        "elbow": shoulder + lengths["upper_arm"] * down,
        "wrist": wrist,
        **_hand(lengths["hand"], wrist),
    }


def _hand(length: float, wrist: Array) -> Joints:
    """Finger joints, on lines down the hand; the index finger is in front."""

    def at(down: float, front: float) -> Array:
        return wrist + length * np.array(tilted((0.0, down, -front), REST.arm_tilt))

    joints = {}
    for i, finger in enumerate(FINGERS):
        front = (i - 1.5) * 0.11
        for n, down in enumerate((0.12, 0.47, 0.70, 0.86)):
            joints[f"{finger}{n}"] = at(down, front * min(1.0, 0.5 + n))
    _, down, back = REST.thumb_direction
    for n, along in ((1, 0.0), (2, 0.24), (3, 0.40)):
        joints[f"thumb{n}"] = at(0.13 + along * down, 0.12 - along * back)
    return joints
