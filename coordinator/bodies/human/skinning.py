"""How far each bone moves each point of the skin: smooth shares that blend across the joints.

Everything is measured in the building pose of `coordinator.bodies.human.shape`. A share of 1 beyond a
joint and 0 before it, blended over a width that suits the joint, splits the skin of a limb between its bones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coordinator.bodies.human.measures import Measures

Array = NDArray[np.float64]
Joints = dict[str, Array]

KEPT = 4

SPINE_ANCHORS = ("pelvis", "vl5", "vl3", "vl1", "vt11", "vt8", "vt5", "vt2", "vc7", "vc4", "skull")
"""Bones of the spine that carry skin: far enough apart for one active vertebra to bend it smoothly."""

_NECK_SHIFT = (0.009, 0.0, -0.018)
"""How much higher than their joints vc7, vc4 and skull hold the skin, as fractions of stature."""


def skin_shares(points: Array, joints: Joints, measures: Measures) -> dict[str, Array]:
    """Share (V,) of each link that carries skin; the shares of a point add up to 1.

    `points` (V, 3) and `joints` (3,) are both in the building pose.
    """
    shares: dict[str, Array] = {}
    left_of_middle = blend(points[:, 0], 0.0, 0.025 * measures.stature)
    trunk = np.ones(len(points))
    for side, here in (("l", left_of_middle), ("r", 1.0 - left_of_middle)):
        mirrored = points * (1.0 if side == "l" else -1.0, 1.0, 1.0)
        at = {name[2:]: point * (1.0 if side == "l" else -1.0, 1.0, 1.0)
              for name, point in joints.items() if name.startswith(f"{side}_")}  # fmt: skip
        arm = _arm_shares(mirrored, at, measures)
        not_arm = 1.0 - sum(arm.values(), np.zeros(len(points)))
        leg = {bone: share * not_arm for bone, share in _leg_shares(mirrored, at, measures).items()}
        limbs = {**arm, **leg}
        for bone, share in limbs.items():
            shares[f"{side}_{bone}"] = share * here
            trunk = trunk - share * here
    for bone, share in _spine_shares(points, joints, measures).items():
        shares[bone] = share * trunk
    return shares


def blend(position: Array, middle: float | Array, half_width: float) -> Array:
    """0 below `middle` - `half_width`, 1 above `middle` + `half_width`, smooth between."""
    t = np.clip((position - middle) / (2.0 * half_width) + 0.5, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _arm_shares(points: Array, at: Joints, measures: Measures) -> dict[str, Array]:
    k = measures.stature
    along, across = _cylindrical(points, at["shoulder"], at["elbow"])
    reach = along - 2.0 * np.maximum(across - 0.035 * k, 0.0)
    upper = blend(reach, 0.020 * k, 0.040 * k)
    fore = blend(along, measures.upper_arm, 0.024 * k) * upper
    hand = blend(along, measures.upper_arm + measures.forearm, 0.014 * k) * upper
    height = blend(-points[:, 1], -at["shoulder"][1] - 0.03 * k, 0.04 * k)
    clavicle = blend(points[:, 0], 0.7 * at["shoulder"][0], 0.4 * at["shoulder"][0]) * height * (1.0 - upper)
    return {"clavicle": clavicle, "upper_arm": upper - fore, "forearm": fore - hand, "hand": hand}


def _leg_shares(points: Array, at: Joints, measures: Measures) -> dict[str, Array]:
    k = measures.stature
    along, _ = _cylindrical(points, at["hip"], at["knee"])
    groin = 0.035 * k - 0.55 * (points[:, 0] - 0.5 * at["hip"][0])
    thigh = blend(points[:, 1], groin, 0.055 * k)
    shank = blend(along, measures.thigh, 0.03 * k)
    foot = blend(along, measures.thigh + measures.shank, 0.016 * k)
    toes = blend(-points[:, 2], -at["metatarsal"][2], 0.018 * k) * foot
    return {"thigh": thigh - shank, "shank": shank - foot, "foot": foot - toes, "toes": toes}


def _cylindrical(points: Array, start: Array, end: Array) -> tuple[Array, Array]:
    """Distance (V,) along the line from `start` to `end`, and across it."""
    direction = (end - start) / np.linalg.norm(end - start)
    along = (points - start) @ direction
    return along, np.linalg.norm(points - start - along[:, None] * direction, axis=1)


def _spine_shares(points: Array, joints: Joints, measures: Measures) -> dict[str, Array]:
    """Quadratic B-splines over the anchors, by level; pelvis and skull are rigid."""
    levels = _level(np.stack([_anchor(name, joints) for name in SPINE_ANCHORS]), joints, measures)
    levels[-3:] += np.array(_NECK_SHIFT) * measures.stature
    ends = 1.5 * levels[[0, -1]] - 0.5 * levels[[1, -2]]
    knots = np.concatenate([ends[:1], levels, ends[1:]])
    places = np.concatenate([[-0.5], np.arange(len(levels)), [len(levels) - 0.5]])
    position = np.interp(_level(points, joints, measures), knots, places)
    shares = np.stack([_spline(position - i) for i in range(len(SPINE_ANCHORS))])
    return dict(zip(SPINE_ANCHORS, shares / shares.sum(axis=0), strict=True))


def _anchor(name: str, joints: Joints) -> Array:
    return joints["skullbase" if name == "skull" else name]


def _level(points: Array, joints: Joints, measures: Measures) -> Array:
    """Height (n,) above the hips, of slanting levels at the neck: the chin is as high as the nape."""
    height = -points[:, 1]
    slant = 0.5 * blend(height, -joints["vc7"][1] - 0.015 * measures.stature, 0.05 * measures.stature)
    return np.asarray(height - slant * points[:, 2])


def _spline(x: Array) -> Array:
    """Quadratic B-spline."""
    x = np.abs(x)
    return np.where(x < 0.5, 0.75 - x**2, 0.5 * np.maximum(1.5 - x, 0.0) ** 2)


def strongest(shares: dict[str, Array], links: tuple[str, ...]) -> tuple[NDArray[np.int64], Array]:
    """The KEPT largest shares of each point as links (V, KEPT) and weights (V, KEPT), largest first."""
    index = np.array([links.index(name) for name in shares])
    table = np.stack(list(shares.values()), axis=1)  # (V, S)
    order = np.argsort(-table, axis=1, kind="stable")[:, :KEPT]
    weights = np.take_along_axis(table, order, axis=1)
    weights[weights < 1e-3] = 0.0
    return index[order], weights / weights.sum(axis=1, keepdims=True)
