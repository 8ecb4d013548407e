"""A body in the form of other programs: a tree of bones, each of which rotates about its origin.

Bones follow the links of the body; the degrees of freedom between two links become the motion of one bone in
another. All bones have the axes of the rest pose, rotated so that y is up. A named joint is the bone with
this origin, or a separate bone that is fixed in its parent. If a joint is near but not at the centre of
rotation, like a person's shoulder, the limb continues from the separate bone: so offsets are constant.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gepf.common.activation import nearest_in
from gepf.common.arrays import Array
from gepf.common.body import ROTATION, BodyModel
from gepf.common.kinematics import dof_transforms
from gepf.coordinator.exports.axes import CAMERA_TO_Y_UP

WORLD = "world"


@dataclass(frozen=True, slots=True, eq=False)
class Bone:
    """One bone.

    parent: index of the parent bone, -1 for the first. dof: last degree of freedom that moves it, -1 for
    none. moves: whether any degree of freedom moves it in its parent. origin (3,): rest pose, metres, y up.
    """

    name: str
    parent: int
    dof: int
    moves: bool
    origin: Array


def bones_of(model: BodyModel) -> tuple[Bone, ...]:
    """The bones of a body, parents first; the first is the only one without a parent."""
    lasts = jointed_dofs(model)
    tops = [dof for dof in lasts if ancestor(model, dof, lasts) < 0]
    bones: list[Bone] = []
    if len(tops) > 1 or tops == [-1]:
        still = model.link_names[model.link_dofs.tolist().index(-1)] if -1 in lasts else WORLD
        bones.append(Bone(still, -1, -1, moves=False, origin=np.zeros(3)))
        lasts = [dof for dof in lasts if dof >= 0]
    for dof in lasts:
        above = ancestor(model, dof, [bone.dof for bone in bones])
        parent = next((b for b, bone in enumerate(bones) if bone.dof == above), -1)
        name = model.link_names[int(np.argmax(model.link_dofs == dof))]
        origin = CAMERA_TO_Y_UP @ pivot(model, above, dof)
        bones.append(Bone(name, parent, dof, moves=True, origin=origin))
    return named_joints(model, bones)


def jointed_dofs(model: BodyModel) -> list[int]:
    """Last degrees of freedom of links that need a bone: with skin, a named joint, or several children."""
    lasts = sorted({int(dof) for dof in model.link_dofs})
    carries = {int(dof) for dof in model.link_dofs[model.skin_links[model.skin_weights > 0]]}
    carries |= {int(dof) for dof in model.link_dofs[model.joint_links]}
    children = [ancestor(model, dof, lasts) for dof in lasts]
    return [dof for dof in lasts if dof in carries or children.count(dof) > 1]


def ancestor(model: BodyModel, dof: int, among: list[int]) -> int:
    """The nearest ancestor of `dof` in `among`; -1 if there is none."""
    return nearest_in(model, among, int(model.parents[dof])) if dof >= 0 else -1


def pivot(model: BodyModel, above: int, dof: int) -> Array:
    """The centre (3,) of rotation of `dof` in `above`: that of the last rotation or translation between."""
    point = model.points[dof]
    while dof not in (above, -1):
        if model.kinds[dof] == ROTATION:
            return np.asarray(model.points[dof])
        point, dof = model.points[dof], int(model.parents[dof])
    return np.asarray(point)


def named_joints(model: BodyModel, bones: list[Bone]) -> tuple[Bone, ...]:
    """The bones with the names and positions of joints, and one more per joint that is at no bone's origin.

    A limb continues from such a joint if it is near its bone's origin.
    """
    max_offset_m, rounding_m = 0.05, 1e-6  # of a joint from the centre of rotation of its bone
    places = model.joint_points @ CAMERA_TO_Y_UP.T
    of_joint = [[bone.dof for bone in bones].index(dof) for dof in model.link_dofs[model.joint_links]]
    left, found, ends = set(range(len(places))), list[Bone](), list[int]()
    for b, bone in enumerate(bones):
        own = [j for j, at in enumerate(of_joint) if at == b]
        apart = np.linalg.norm(places[own] - bone.origin, axis=1)
        name, parent = bone.name, ends[bone.parent] if bone.parent >= 0 else -1
        if name in model.joint_names:
            name = f"{name}_link"  # which no joint has
        if own and apart.min() < max_offset_m:
            j = own[int(apart.argmin())]
            left.remove(j)
            joint = Bone(model.joint_names[j], parent, bone.dof, moves=bone.moves, origin=places[j])
            if bone.parent >= 0 and apart.min() > rounding_m and is_hinged(model, bones, bone):
                found.append(replace(bone, name=name, parent=parent))
                joint = replace(joint, parent=len(found) - 1, moves=False)
        else:
            joint = replace(bone, name=name, parent=parent)
        found.append(joint)
        ends.append(len(found) - 1)
    still = [
        Bone(model.joint_names[j], ends[of_joint[j]], bones[of_joint[j]].dof, moves=False, origin=places[j])
        for j in sorted(left)
    ]
    return (*found, *still)


def is_hinged(model: BodyModel, bones: list[Bone], bone: Bone) -> bool:
    """Whether a bone only rotates in its parent."""
    above, dof = bones[bone.parent].dof, bone.dof
    while dof not in (above, -1):
        if model.kinds[dof] != ROTATION:
            return False
        dof = int(model.parents[dof])
    return True


def motion_of(model: BodyModel, bones: tuple[Bone, ...], poses: Array, to_y_up: Array) -> tuple[Array, Array]:
    """Rotations (F, B, 3, 3) and origins (F, B, 3) of each bone in its parent; of the first in the world.

    `to_y_up` (3, 3) rotates the camera's axes to the world's.
    """
    t_dofs = dof_transforms(model, poses)  # (F, D, 3, 4)
    rotations = np.empty((len(poses), len(bones), 3, 3))
    places = np.empty((len(poses), len(bones), 3))
    for b, bone in enumerate(bones):
        if bone.dof < 0:
            level = to_y_up @ CAMERA_TO_Y_UP
            rotations[:, b], places[:, b] = level, level @ bone.origin
            continue
        turned = to_y_up @ t_dofs[:, bone.dof, :, :3] @ CAMERA_TO_Y_UP
        rotations[:, b] = turned
        places[:, b] = turned @ bone.origin + t_dofs[:, bone.dof, :, 3] @ to_y_up.T
    local_turns, local_places = rotations.copy(), places.copy()
    for b, bone in enumerate(bones):
        if bone.parent >= 0:
            back = np.swapaxes(rotations[:, bone.parent], -1, -2)
            local_turns[:, b] = back @ rotations[:, b]
            local_places[:, b] = np.einsum("fij,fj->fi", back, places[:, b] - places[:, bone.parent])
    return local_turns, local_places


def continuous(rotations: Rotation) -> Array:
    """Unit quaternions (F, 4), x y z w, of rotations (F,), each on the side of the one before."""
    values: Array = rotations.as_quat()
    flips = np.sum(values[1:] * values[:-1], axis=1) < 0.0
    values[1:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
    return values


def children(bones: tuple[Bone, ...], b: int) -> list[int]:
    """The children of a bone."""
    return [c for c, bone in enumerate(bones) if bone.parent == b]


def offset(bones: tuple[Bone, ...], bone: Bone) -> Array:
    """Offset (3,) from the parent's origin to the bone's, in the rest pose."""
    return bone.origin - bones[bone.parent].origin if bone.parent >= 0 else bone.origin


def slides(bones: tuple[Bone, ...], bone: Bone, places: Array) -> bool:
    """Whether the origin (F, 3) of a bone in its parent differs from the rest pose by more than rounding."""
    return bool(np.any(np.abs(places - offset(bones, bone)) > 1e-6))
