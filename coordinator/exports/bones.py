"""A body as other programs know one: a tree of bones, each turning about its own origin.

Bones follow the body's links; degrees of freedom between two links become the motion of one bone in
another. All bones have the axes of the rest pose, turned so that y is up. A named joint of the body is the
bone whose origin it is, or a bone of its own that never moves in its parent. A joint that lies beside the
point about which its bone turns, as a person's shoulder does, is that bone's origin, which then slides. A
bone that never moves stays where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from common.body import ROTATION, TRANSLATION, BodyModel
from common.kinematics import dof_transforms
from coordinator.exports.recorded import CAMERA_TO_Y_UP

Array = NDArray[np.float64]

WORLD = "world"
SAME_PLACE_M = 1e-6
NEAR_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Bone:
    """One bone.

    parent: index of the bone it hangs from, -1 for the first. dof: last degree of freedom that moves it, -1
    for none. dofs: those that move it in its parent. origin (3,): rest pose, metres, y up.
    """

    name: str
    parent: int
    dof: int
    dofs: tuple[int, ...]
    origin: Array
    slides: bool  # whether its origin moves in its parent


def bones_of(model: BodyModel) -> tuple[Bone, ...]:
    """The bones of a body, parents first; the first is the only one without a parent."""
    lasts = jointed_dofs(model)
    tops = [dof for dof in lasts if ancestor(model, dof, lasts) < 0]
    bones: list[Bone] = []
    if len(tops) > 1 or tops == [-1]:
        still = model.link_names[model.link_dofs.tolist().index(-1)] if -1 in lasts else WORLD
        bones.append(Bone(still, -1, -1, (), np.zeros(3), slides=False))
        lasts = [dof for dof in lasts if dof >= 0]
    for dof in lasts:
        above = ancestor(model, dof, [bone.dof for bone in bones])
        parent = next((b for b, bone in enumerate(bones) if bone.dof == above), -1)
        dofs = between(model, above, dof)
        name = model.link_names[int(np.argmax(model.link_dofs == dof))]
        points = model.points[[d for d in dofs if model.kinds[d] == ROTATION]]
        one_point = bool(np.all(np.abs(points - points[-1:]) < SAME_PLACE_M))
        slides = bool(np.any(model.kinds[list(dofs)] == TRANSLATION)) or not one_point
        bones.append(Bone(name, parent, dof, dofs, CAMERA_TO_Y_UP @ pivot(model, dofs), slides))
    return named_joints(model, bones)


def jointed_dofs(model: BodyModel) -> list[int]:
    """Last degrees of freedom of links that need a bone: with skin, a named joint, or several children."""
    lasts = sorted({int(dof) for dof in model.link_dofs})
    carries = {int(dof) for dof in model.link_dofs[model.skin_links[model.skin_weights > 0]]}
    carries |= {int(dof) for dof in model.link_dofs[model.joint_links]}
    children = [ancestor(model, dof, lasts) for dof in lasts]
    return [dof for dof in lasts if dof in carries or children.count(dof) > 1]


def ancestor(model: BodyModel, dof: int, among: list[int]) -> int:
    """The nearest degree of freedom above `dof` that is one of `among`, -1 where there is none."""
    above = int(model.parents[dof]) if dof >= 0 else -1
    while above >= 0 and above not in among:
        above = int(model.parents[above])
    return above


def between(model: BodyModel, above: int, dof: int) -> tuple[int, ...]:
    """Degrees of freedom after `above` up to and with `dof`, in chain order."""
    chain: list[int] = []
    while dof not in (above, -1):
        chain.append(dof)
        dof = int(model.parents[dof])
    return tuple(reversed(chain))


def pivot(model: BodyModel, dofs: tuple[int, ...]) -> Array:
    """The point (3,) that the chain turns about: of its last rotation, or of its first part."""
    turning = [d for d in dofs if model.kinds[d] == ROTATION]
    return np.asarray(model.points[turning[-1] if turning else dofs[0]])


def named_joints(model: BodyModel, bones: list[Bone]) -> tuple[Bone, ...]:
    """The bones with the body's joint names and in their places, and one more for each joint near no bone."""
    places = model.joint_points @ CAMERA_TO_Y_UP.T
    of_joint = [[bone.dof for bone in bones].index(dof) for dof in model.link_dofs[model.joint_links]]
    apart = [float(np.linalg.norm(bones[b].origin - places[j])) for j, b in enumerate(of_joint)]
    named: dict[int, int] = {}
    for j in sorted(range(len(apart)), key=lambda j: apart[j] > SAME_PLACE_M):
        b = of_joint[j]
        if apart[j] < (NEAR_M if bones[b].dofs else SAME_PLACE_M):
            named.setdefault(b, j)
    for b, j in named.items():
        beside = apart[j] > SAME_PLACE_M
        bones[b] = replace(
            bones[b], origin=places[j] if beside else bones[b].origin, slides=bones[b].slides or beside
        )
    names = {b: model.joint_names[j] for b, j in named.items()}
    more = [
        Bone(name, of_joint[j], bones[of_joint[j]].dof, (), places[j], slides=False)
        for j, name in enumerate(model.joint_names)
        if named.get(of_joint[j]) != j
    ]
    for b, bone in enumerate(bones):
        own = f"{bone.name}_link" if bone.name in model.joint_names else bone.name  # which no joint has
        bones[b] = replace(bone, name=names.get(b, own))
    return (*bones, *more)


def motion_of(
    model: BodyModel, bones: tuple[Bone, ...], poses: Array, to_y_up: Array = CAMERA_TO_Y_UP
) -> tuple[Array, Array]:
    """Rotations (F, B, 3, 3) and origins (F, B, 3) of each bone in its parent, the first's in the world.

    `to_y_up` (3, 3) leads from the camera's axes to the world's.
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
    return in_parents(bones, rotations, places)


def in_parents(bones: tuple[Bone, ...], rotations: Array, places: Array) -> tuple[Array, Array]:
    """Motion in the world, in the parent's axes and from the parent's origin."""
    local_turns, local_places = rotations.copy(), places.copy()
    for b, bone in enumerate(bones):
        if bone.parent >= 0:
            back = np.swapaxes(rotations[:, bone.parent], -1, -2)
            local_turns[:, b] = back @ rotations[:, b]
            local_places[:, b] = np.einsum("fij,fj->fi", back, places[:, b] - places[:, bone.parent])
    return local_turns, local_places


def children(bones: tuple[Bone, ...], b: int) -> list[int]:
    """The bones that hang from one."""
    return [c for c, bone in enumerate(bones) if bone.parent == b]


def offset(bones: tuple[Bone, ...], bone: Bone) -> Array:
    """From the parent's origin to the bone's (3,), in the rest pose."""
    return bone.origin - bones[bone.parent].origin if bone.parent >= 0 else bone.origin
