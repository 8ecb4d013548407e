"""Moves a person of MakeHuman, who stands with arms and legs spread, to the rest pose of our skeleton."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from gepf.common.arrays import Array, Indices
from gepf.common.camera import rigid
from gepf.coordinator.bodies.human.build.joints import PLACES
from gepf.coordinator.bodies.human.skeleton import DOWN, FRONT, LEFT, REST, tilted

Joints = Mapping[str, Array]

TRUNK = ("pelvis", "vl5", "vl3", "vl1", "vt8", "vc7", "vc4", "skull", "l_clavicle", "r_clavicle")
"""Links that keep their relative pose."""

LINK_OF = {
    "root": "pelvis", "pelvis": "pelvis", "spine05": "pelvis", "spine04": "vl5", "spine03": "vl3",
    "spine02": "vl1", "spine01": "vt8", "breast": "vt8", "neck01": "vc7", "neck02": "vc4", "neck03": "vc4",
    "clavicle": "clavicle", "shoulder01": "clavicle", "upperarm01": "upper_arm", "upperarm02": "upper_arm",
    "lowerarm01": "forearm", "lowerarm02": "forearm", "wrist": "hand", "metacarpal": "hand", "finger": "hand",
    "upperleg01": "thigh", "upperleg02": "thigh", "lowerleg01": "shank", "lowerleg02": "shank",
    "foot": "foot", "toe": "toes",
}  # fmt: skip
"""How the names of MakeHuman's bones begin -> our link with skin; all other bones are in the head."""

BONE_OF = {
    "pelvis": ("pelvis", "vl5"), "vl5": ("vl5", "vl3"), "vl3": ("vl3", "vl1"), "vl1": ("vl1", "vt8"),
    "vt8": ("vt8", "vc7"), "vc7": ("vc7", "vc4"), "vc4": ("vc4", "skullbase"), "skull": ("skullbase", "head"),
    "clavicle": ("sternoclavicular", "shoulder"), "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"), "hand": ("wrist", "middle3"), "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"), "foot": ("ankle", "metatarsal"), "toes": ("midtarsal", "metatarsal"),
}  # fmt: skip
"""Link with skin -> the joints at both ends of its bone."""


def link_of(bone: str) -> str:
    """Our link that carries the skin of a bone of MakeHuman."""
    stem, _, side = bone.partition(".")
    link = next((link for start, link in LINK_OF.items() if stem.startswith(start)), "skull")
    return link if link in TRUNK else f"{side.lower()}_{link}"


def fold_fingers(vertices: Array, at: Joints, weights: Mapping[str, tuple[Indices, Array]]) -> Array:
    """Vertices (N, 3) with relaxed hands; `at` are MakeHuman's joints by name."""
    moved, thumb, fingers = vertices.copy(), 1, (2, 3, 4, 5)
    folded_deg, adducted_deg = (15.0, 25.0, 15.0), (30.0, 0.0, 0.0)  # joints of a finger; of the thumb
    for side in "lr":
        knuckles = [at[f"{side}-finger-{n}-1"] for n in fingers]
        hand = knuckles[1] - at[f"{side}-hand"]
        palm = (-1.0 if side == "l" else 1.0) * np.cross(hand, knuckles[0] - knuckles[-1])
        for n in (thumb, *fingers):
            towards, angles_deg = (hand, adducted_deg) if n == thumb else (palm, folded_deg)
            motion = np.eye(4)
            for k, angle in enumerate(np.radians(angles_deg), 1):
                centre, along = at[f"{side}-finger-{n}-{k}"], at[f"{side}-finger-{n}-{k + 1}"]
                axis = np.cross(along - centre, towards)
                turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
                motion = motion @ rigid(turn, centre - turn @ centre)
                rows, shares = weights[f"finger{n}-{k}.{side.upper()}"]
                there = vertices[rows] @ motion[:3, :3].T + motion[:3, 3]
                moved[rows] += shares[:, None] * (there - vertices[rows])
    return moved


def measure(at: Joints, stature: float, sole: float, foot: float) -> dict[str, float]:
    """Our lengths of a person of MakeHuman, as shares of stature, from joints (3,) relative to the hips."""

    def chain(*names: str) -> float:
        points = np.array([at[f"l-{name}"] for name in names])
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) / stature

    _, up, back = at["l-shoulder"] / stature
    return {
        "upper_arm": chain("shoulder", "elbow"),
        "forearm": chain("elbow", "hand"),
        "hand": chain("hand", *(f"finger-3-{k}" for k in (1, 2, 3, 4))),
        "thigh": chain("upper-leg", "knee"),
        "shank": chain("knee", "ankle"),
        "ankle_height": (sole - at["l-ankle"][1]) / stature,
        "foot": foot / stature,
        "trunk": float(np.sqrt(up**2 + back**2 - PLACES.shoulder_back**2)),
        "shoulder_width": 2.0 * at["l-shoulder"][0] / stature,
        "hip_width": 2.0 * at["l-upper-leg"][0] / stature,
    }


def to_rest(at: Joints, rest: Joints) -> dict[str, Array]:
    """Transforms (4, 4) of links with skin from MakeHuman's pose to rest, where joints are at `rest`."""
    down, ahead, left = np.array(tilted(DOWN, REST.arm_tilt)), np.array(FRONT), np.array(LEFT)
    shoulder, elbow, wrist = (at[f"l-{name}"] for name in ("shoulder", "elbow", "hand"))
    hip, knee, ankle = (at[f"l-{name}"] for name in ("upper-leg", "knee", "ankle"))
    middle, upright = shoulder * (0.0, 1.0, 1.0), rest["l_shoulder"] * (0.0, 1.0, 1.0)
    hand, knuckles = at["l-finger-3-1"] - wrist, at["l-finger-2-1"] - at["l-finger-5-1"]
    thigh, shank = rest["l_knee"] - rest["l_hip"], rest["l_ankle"] - rest["l_knee"]
    left_limbs = {
        "upper_arm": move(shoulder, rest["l_shoulder"], (elbow - shoulder, wrist - elbow), (down, ahead)),
        "forearm": move(elbow, rest["l_elbow"], (wrist - elbow, shoulder - elbow), (down, ahead)),
        "hand": move(wrist, rest["l_wrist"], (hand, knuckles), (down, ahead)),
        "thigh": move(hip, rest["l_hip"], (knee - hip, ahead), (thigh, ahead)),
        "shank": move(knee, rest["l_knee"], (ankle - knee, ahead), (shank, ahead)),
        "foot": move(ankle, rest["l_ankle"], (left, ahead), (left, ahead)),
    }
    left_limbs["toes"] = left_limbs["foot"]
    trunk = move(np.zeros(3), np.zeros(3), (middle, left), (upright, left))
    mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
    return {
        **dict.fromkeys(TRUNK, trunk),
        **{f"l_{link}": transform for link, transform in left_limbs.items()},
        **{f"r_{link}": mirror @ transform @ mirror for link, transform in left_limbs.items()},
    }


def move(start: Array, to: Array, before: tuple[Array, Array], after: tuple[Array, Array]) -> Array:
    """The rigid transform (4, 4) of `start` to `to` and directions `before` to `after`, the first exactly."""
    rotation = frame(*after) @ frame(*before).T
    return rigid(rotation, to - rotation @ start)


def frame(first: Array, second: Array) -> Array:
    """Orthonormal columns (3, 3): along the first vector, and the second where it is perpendicular."""
    x = first / np.linalg.norm(first)
    y = second - (second @ x) * x
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def stretch(points: Array, shares: Mapping[str, Array], before: Joints, after: Joints) -> Array:
    """Points (V, 3) at rest, moved and stretched with the bones between joints."""
    moved = points.copy()
    for link, share in shares.items():
        names = [bone_side(link, end) for end in BONE_OF[link.removeprefix("l_").removeprefix("r_")]]
        (start, end), (new_start, new_end) = ([joints[name] for name in names] for joints in (before, after))
        along = np.clip((points - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
        step = (new_start - start) + along[:, None] * ((new_end - end) - (new_start - start))
        moved += share[:, None] * step
    return moved


def bone_side(link: str, joint: str) -> str:
    """The joint on the side of a link."""
    return f"{link[:2]}{joint}" if link.startswith(("l_", "r_")) else joint
