"""The human template: a clothed adult made from measures, with every joint angle of MPEG-4.

model = human(1.80)
body = activate(model, DEFAULT_ACTIVE, np.zeros(len(model.dof_names)))
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel, find_balls
from common.kinematics import dof_transforms
from coordinator.bodies.human.measures import REFERENCE_STATURE, Measures
from coordinator.bodies.human.ranges import joint_range, rest_spread
from coordinator.bodies.human.shape import ARMS_RAISED, LEGS_SPREAD, moved, shape_person
from coordinator.bodies.human.skeleton import ARM_TILT, Skeleton, build_skeleton
from coordinator.bodies.human.skinning import KEPT, skin_shares, strongest
from coordinator.bodies.human.surface import mesh_symmetric

Array = NDArray[np.float64]

DEFAULT_ACTIVE: tuple[str, ...] = (
    "root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz",
    "l_shoulder_flexion", "l_shoulder_abduct", "l_shoulder_twisting", "l_elbow_flexion",
    "r_shoulder_flexion", "r_shoulder_abduct", "r_shoulder_twisting", "r_elbow_flexion",
    "l_hip_flexion", "l_hip_abduct", "l_hip_twisting", "l_knee_flexion", "l_ankle_flexion",
    "r_hip_flexion", "r_hip_abduct", "r_hip_twisting", "r_knee_flexion", "r_ankle_flexion",
)  # fmt: skip
"""The 24 degrees of freedom of the paper's section 5."""

CELL = 0.0164
"""Distance of neighbouring vertices, about, as a fraction of stature."""

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
"""Output joint -> its link and its place in the skeleton."""


def human(stature_m: float = REFERENCE_STATURE, girth: float = 1.0, **lengths: float) -> BodyModel:
    """A person of this stature (metres); `girth` widens trunk and limbs, `lengths` are measures in metres.

    All 186 degrees of freedom, root first. Raises InputError for measures that no person has.
    """
    return human_of(Measures.of(stature_m, girth, **lengths))


@lru_cache(maxsize=4)
def human_of(measures: Measures) -> BodyModel:
    """A person of these measures. The same measures give the same bytes; the last few are kept."""
    return mesh_person(raise_arms(measures))[0]


@dataclass(frozen=True, slots=True, eq=False)
class Raised:
    """A person without skin in the building pose, in which the surface is made.

    joints: Centres (3,) there. transforms: Of each degree of freedom (D, 3, 4), from rest to there.
    """

    measures: Measures
    skeleton: Skeleton
    bare: BodyModel
    transforms: Array
    joints: dict[str, Array]


def raise_arms(measures: Measures) -> Raised:
    """A person of these measures in the building pose."""
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
    """Undo the blended motion of the building pose, which has moved each degree of freedom (D, 3, 4)."""
    t_links = transforms[skinned.link_dofs]
    blended = np.einsum("vkij,vk->vij", t_links[skinned.skin_links], skinned.skin_weights)
    return np.linalg.solve(blended[:, :, :3], (vertices - blended[:, :, 3])[..., None])[..., 0]
