"""The human template: a clothed adult with given measures and all joint angles of MPEG-4.

model = human(1.80)
body = activate(model, DEFAULT_ACTIVE, np.zeros(len(model.dof_names)))

Skinning is computed in the building pose of `coordinator.bodies.human.shape`. The skin of a limb is divided
between its bones by a share of 1 beyond a joint and 0 before it, blended over a width for each joint.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel, find_balls
from common.kinematics import dof_transforms
from coordinator.bodies.human.dofs import joint_range, rest_spread
from coordinator.bodies.human.measures import REFERENCE_STATURE, Measures
from coordinator.bodies.human.mesh import mesh_symmetric
from coordinator.bodies.human.shape import ARMS_RAISED, LEGS_SPREAD, moved, shape_person
from coordinator.bodies.human.skeleton import ARM_TILT, Skeleton, build_skeleton

Array = NDArray[np.float64]
Joints = dict[str, Array]

KEPT = 4

SPINE_ANCHORS = ("pelvis", "vl5", "vl3", "vl1", "vt11", "vt8", "vt5", "vt2", "vc7", "vc4", "skull")
"""Bones of the spine with skin: far enough apart that one active vertebra bends it smoothly."""

_NECK_SHIFT = (0.009, 0.0, -0.018)
"""Height of the skin of vc7, vc4 and skull above their joints, as fractions of stature."""


def skin_shares(points: Array, joints: Joints, measures: Measures) -> dict[str, Array]:
    """Share (V,) of each link with skin; the shares of a point sum to 1.

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
    """Distances (V,) along the line from `start` to `end`, and from it."""
    direction = (end - start) / np.linalg.norm(end - start)
    along = (points - start) @ direction
    return along, np.linalg.norm(points - start - along[:, None] * direction, axis=1)


def _spine_shares(points: Array, joints: Joints, measures: Measures) -> dict[str, Array]:
    """Quadratic B-splines over the anchors, by level; pelvis and skull are rigid."""
    anchors = np.stack([joints[name] for name in (*SPINE_ANCHORS[:-1], "skullbase")])
    levels = _level(anchors, joints, measures)
    levels[-3:] += np.array(_NECK_SHIFT) * measures.stature
    ends = 1.5 * levels[[0, -1]] - 0.5 * levels[[1, -2]]
    knots = np.concatenate([ends[:1], levels, ends[1:]])
    places = np.concatenate([[-0.5], np.arange(len(levels)), [len(levels) - 0.5]])
    position = np.interp(_level(points, joints, measures), knots, places)
    x = np.abs(position - np.arange(len(SPINE_ANCHORS))[:, None])
    shares = np.where(x < 0.5, 0.75 - x**2, 0.5 * np.maximum(1.5 - x, 0.0) ** 2)
    return dict(zip(SPINE_ANCHORS, shares / shares.sum(axis=0), strict=True))


def _level(points: Array, joints: Joints, measures: Measures) -> Array:
    """Height (n,) above the hips, with tilted levels at the neck: chin and nape have the same height."""
    height = -points[:, 1]
    slant = 0.5 * blend(height, -joints["vc7"][1] - 0.015 * measures.stature, 0.05 * measures.stature)
    return np.asarray(height - slant * points[:, 2])


def strongest(shares: dict[str, Array], links: tuple[str, ...]) -> tuple[NDArray[np.int64], Array]:
    """The KEPT largest shares of each point as links (V, KEPT) and weights (V, KEPT), largest first."""
    index = np.array([links.index(name) for name in shares])
    table = np.stack(list(shares.values()), axis=1)  # (V, S)
    order = np.argsort(-table, axis=1, kind="stable")[:, :KEPT]
    weights = np.take_along_axis(table, order, axis=1)
    weights[weights < 1e-3] = 0.0
    return index[order], weights / weights.sum(axis=1, keepdims=True)


DEFAULT_ACTIVE: tuple[str, ...] = (
    "root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz",
    "l_shoulder_flexion", "l_shoulder_abduct", "l_shoulder_twisting", "l_elbow_flexion",
    "r_shoulder_flexion", "r_shoulder_abduct", "r_shoulder_twisting", "r_elbow_flexion",
    "l_hip_flexion", "l_hip_abduct", "l_hip_twisting", "l_knee_flexion", "l_ankle_flexion",
    "r_hip_flexion", "r_hip_abduct", "r_hip_twisting", "r_knee_flexion", "r_ankle_flexion",
)  # fmt: skip
"""The 24 degrees of freedom of the paper's section 5."""

CELL = 0.0164
"""Approximate distance of neighbouring vertices, as a fraction of stature."""

_NAMED_JOINTS = {
    "pelvis": ("pelvis", "pelvis"), "neck": ("vt1", "vc7"), "head": ("skull", "head"),
    **{
        f"{word}_{joint}": (f"{side}_{link}", f"{side}_{place}")
        for word, side in (("right", "r"), ("left", "l"))
        for joint, link, place in (
            ("shoulder", "upper_arm", "glenohumeral"), ("elbow", "forearm", "elbow"),
            ("wrist", "hand", "wrist"), ("hip", "thigh", "hip"), ("knee", "shank", "knee"),
            ("ankle", "talus", "ankle"),
        )
    },
}  # fmt: skip
"""Output joint -> its link and its joint in the skeleton."""


def human(stature_m: float = REFERENCE_STATURE, girth: float = 1.0, **lengths: float) -> BodyModel:
    """A person of this stature (metres); `girth` scales the width, `lengths` are measures in metres.

    All 186 degrees of freedom, root first. Raises InputError for implausible measures.
    """
    return human_of(Measures.of(stature_m, girth, **lengths))


@lru_cache(maxsize=4)
def human_of(measures: Measures) -> BodyModel:
    """A person with these measures. The same measures give the same bytes; the last few are cached."""
    return mesh_person(raise_arms(measures))[0]


@dataclass(frozen=True, slots=True, eq=False)
class Raised:
    """A person without skin in the building pose, in which the surface is computed.

    joints: Centres (3,) in this pose. transforms: Of each degree of freedom (D, 3, 4), from rest to this
    pose.
    """

    measures: Measures
    skeleton: Skeleton
    bare: BodyModel
    transforms: Array
    joints: dict[str, Array]


def raise_arms(measures: Measures) -> Raised:
    """A person with these measures in the building pose."""
    skeleton = build_skeleton(measures)
    bare = _without_skin(skeleton)
    raised = dof_transforms(bare, _building_pose(bare)[None])[0]
    joints = {dof.joint: moved(raised[j], skeleton.joints[dof.joint]) for j, dof in enumerate(skeleton.dofs)}
    return Raised(measures, skeleton, bare, raised, joints)


def mesh_person(raised: Raised) -> tuple[BodyModel, Array]:
    """The person at rest, and its vertices (V, 3) in the building pose."""
    measures = raised.measures
    shape = shape_person(measures, raised.skeleton)
    vertices, triangles = mesh_symmetric(shape.distance, *_left_half(measures), CELL * measures.stature)
    links, weights = strongest(skin_shares(vertices, raised.joints, measures), raised.bare.link_names)
    skinned = replace(raised.bare, triangles=triangles, skin_links=links, skin_weights=weights)
    return replace(skinned, vertices=lay_to_rest(skinned, vertices, raised.transforms)), vertices


def _without_skin(skeleton: Skeleton) -> BodyModel:
    names = tuple(dof.name for dof in skeleton.dofs)
    kinds = np.array([dof.kind for dof in skeleton.dofs], dtype=np.int64)
    parents = np.array(
        [names.index(dof.parent) if dof.parent else -1 for dof in skeleton.dofs], dtype=np.int64
    )
    axes = np.array([dof.axis for dof in skeleton.dofs])
    points = np.array([skeleton.joints[dof.joint] for dof in skeleton.dofs])
    links = tuple(skeleton.links)
    link_dofs = np.array([names.index(last) for last in skeleton.links.values()], dtype=np.int64)
    return BodyModel(
        name="human",
        dof_names=names,
        kinds=kinds,
        parents=parents,
        axes=axes,
        points=points,
        limits=np.stack([joint_range(name) for name in names]),
        rest_spreads=np.array([rest_spread(name) for name in names]),
        balls=find_balls(kinds, parents, axes, points, link_dofs),
        link_names=links,
        link_dofs=link_dofs,
        vertices=np.empty((0, 3)),
        triangles=np.empty((0, 3), dtype=np.int64),
        skin_links=np.empty((0, KEPT), dtype=np.int64),
        skin_weights=np.empty((0, KEPT)),
        joint_names=tuple(_NAMED_JOINTS),
        joint_links=np.array([links.index(link) for link, _ in _NAMED_JOINTS.values()], dtype=np.int64),
        joint_points=np.array([skeleton.joints[place] for _, place in _NAMED_JOINTS.values()]),
    )


def _building_pose(model: BodyModel) -> Array:
    pose = np.zeros(len(model.dof_names))
    for side in "lr":
        pose[model.dof(f"{side}_shoulder_abduct")] = ARMS_RAISED - ARM_TILT
        pose[model.dof(f"{side}_hip_abduct")] = LEGS_SPREAD
    return pose


def _left_half(measures: Measures) -> tuple[Array, Array]:
    """Corners of a box around the left half of the body in the building pose."""
    arm = measures.upper_arm + measures.forearm + measures.hand
    leg = measures.thigh + measures.shank + measures.ankle_height
    deep = 0.16 * measures.stature * max(1.0, measures.girth)
    wide = 0.5 * measures.shoulder_width + 0.85 * arm
    tall = 1.40 * measures.trunk + 0.11 * measures.stature
    return np.array([0.0, -tall, -deep]), np.array([wide, leg + 0.02 * measures.stature, deep])


def lay_to_rest(skinned: BodyModel, vertices: Array, transforms: Array) -> Array:
    """Invert the blended motion to the building pose, given by transforms (D, 3, 4)."""
    t_links = transforms[skinned.link_dofs]
    blended = np.einsum("vkij,vk->vij", t_links[skinned.skin_links], skinned.skin_weights)
    return np.linalg.solve(blended[:, :, :3], (vertices - blended[:, :, 3])[..., None])[..., 0]
