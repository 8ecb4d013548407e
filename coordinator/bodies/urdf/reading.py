"""A URDF file as a body: any tree of revolute, continuous, prismatic and fixed joints.

The body's rest pose is the robot with all joints at zero, its base link's z axis up and its x axis towards
the camera, so that a robot stands and faces the camera as a person does at rest; its root has the usual
six degrees of freedom. Joints keep their names. Links that fixed joints hold together become one.
"""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yourdfpy
from numpy.typing import NDArray

from common.body import ROOT_DOFS, ROTATION, TRANSLATION, BodyModel, find_balls, surface_carriers
from common.errors import InputError
from coordinator.bodies.human.sampling import sample_evenly
from coordinator.bodies.urdf.loading import load
from coordinator.bodies.urdf.surfaces import join, surfaces
from coordinator.bodies.urdf.text import check_text

Array = NDArray[np.float64]

REST_FROM_URDF = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
"""URDF: x forward, y left, z up. Rest: x to the body's left, y down, z to its back."""

logger = logging.getLogger(__name__)

MOVING = {"revolute": ROTATION, "continuous": ROTATION, "prismatic": TRANSLATION}
BASE = len(ROOT_DOFS) - 1


def read_urdf(path: Path) -> BodyModel:
    """The body that a URDF file describes; InputError for what is none or cannot be tracked."""
    if not path.is_file():
        raise InputError(f"no such file: {path}; give --model human or a URDF file")
    check_text(path)
    robot = load(path, build_scene_graph=False, load_meshes=False).robot
    check_tree(path, robot)
    joints = in_tree_order(path, robot)
    t_links = place_links(robot, joints)
    moving = [joint for joint in joints if joint.type in MOVING]
    dof_of = assign_dofs(robot, joints, moving)

    skin = cover(path, t_links, dof_of)
    kinds = np.array([TRANSLATION] * 3 + [ROTATION] * 3 + [MOVING[j.type] for j in moving], dtype=np.int64)
    parents = np.array([*range(-1, BASE), *(dof_of[j.parent] for j in moving)], dtype=np.int64)
    axes = np.array([*np.eye(3), *np.eye(3), *(axis_at_rest(j, t_links) for j in moving)])
    points = np.array([*np.zeros((6, 3)), *(t_links[j.child][:3, 3] for j in moving)])
    link_dofs = np.arange(BASE, len(kinds), dtype=np.int64)
    base = base_link(robot)
    return BodyModel(
        name=robot.name,
        dof_names=(*ROOT_DOFS, *(j.name for j in moving)),
        kinds=kinds,
        parents=parents,
        axes=axes,
        points=points,
        rest_spreads=np.ones(len(kinds)),
        limits=np.array([(-np.inf, np.inf)] * 6 + [limits_of(path, j) for j in moving]),
        balls=find_balls(kinds, parents, axes, points, surface_carriers(link_dofs, skin.links, skin.weights)),
        link_names=(base, *(j.child for j in moving)),
        link_dofs=link_dofs,
        vertices=skin.vertices,
        triangles=skin.triangles,
        skin_links=skin.links,
        skin_weights=skin.weights,
        joint_names=(base, *(j.name for j in joints)),
        joint_links=np.array([0, *(dof_of[j.child] - BASE for j in joints)], dtype=np.int64),
        joint_points=np.array([t_links[base][:3, 3], *(t_links[j.child][:3, 3] for j in joints)]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """A surface at rest: vertices (V, 3), triangles (F, 3), and the one link of each vertex (V, 1)."""

    vertices: Array
    triangles: NDArray[np.int64]
    links: NDArray[np.int64]
    weights: Array


def cover(path: Path, t_links: dict[str, Array], dof_of: dict[str, int]) -> Skin:
    """The surfaces of all links, sampled evenly."""
    carried = surfaces(path, t_links)
    sampled = sample_evenly(list(carried.values()))
    vertices, triangles = join(sampled)
    owners = np.repeat([dof_of[link] for link in carried], [len(part.vertices) for part in sampled])
    links = (owners - BASE)[:, None].astype(np.int64)
    return Skin(vertices, triangles, links, np.ones((len(owners), 1)))


def check_tree(path: Path, robot: yourdfpy.Robot) -> None:
    """InputError for joints that cannot be tracked, and names that are missing or there twice."""
    for joint in robot.joints:
        if joint.type not in {*MOVING, "fixed"}:
            raise InputError(
                f"{path}: joint '{joint.name}' is {joint.type}; only revolute, continuous, prismatic "
                "and fixed joints can be tracked"
            )
        if joint.mimic is not None and joint.mimic.joint:
            logger.warning(
                "%s: joint '%s' mimics '%s'; it is tracked on its own", path, joint.name, joint.mimic.joint
            )
        if joint.type in MOVING and not np.linalg.norm(joint.axis) > 0.0:
            raise InputError(f"{path}: the axis of joint '{joint.name}' is zero; give it a direction")
    names = [*ROOT_DOFS, base_link(robot), *(joint.name for joint in robot.joints)]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"{path}: the name '{twice[0]}' is there twice; give every joint one of its own")


def base_link(robot: yourdfpy.Robot) -> str:
    """The first link that is nobody's child; no name where there is none."""
    children = {joint.child for joint in robot.joints}
    return next((link.name for link in robot.links if link.name not in children), "")


def in_tree_order(path: Path, robot: yourdfpy.Robot) -> list[yourdfpy.Joint]:
    """Joints from the base outward; InputError if they make no tree."""
    reached, order = {base_link(robot)}, []
    waiting = list(robot.joints)
    while ready := [joint for joint in waiting if joint.parent in reached]:
        joint = ready[0]
        order.append(joint)
        reached.add(joint.child)
        waiting.remove(joint)
    if waiting or len(reached) != len(robot.links) or len(order) != len(robot.links) - 1:
        raise InputError(f"{path}: links and joints make no single tree; every link but one needs one parent")
    return order


def place_links(robot: yourdfpy.Robot, joints: list[yourdfpy.Joint]) -> dict[str, Array]:
    """T_rest_link (4, 4) of every link with all joints at zero."""
    start = np.eye(4)
    start[:3, :3] = REST_FROM_URDF
    placed = {base_link(robot): start}
    for joint in joints:
        origin = np.eye(4) if joint.origin is None else joint.origin
        placed[joint.child] = placed[joint.parent] @ origin
    return placed


def assign_dofs(
    robot: yourdfpy.Robot, joints: list[yourdfpy.Joint], moving: list[yourdfpy.Joint]
) -> dict[str, int]:
    """The last degree of freedom that moves each link."""
    own = {joint.name: BASE + 1 + i for i, joint in enumerate(moving)}
    last = {base_link(robot): BASE}
    for joint in joints:
        last[joint.child] = own.get(joint.name, last[joint.parent])
    return last


def axis_at_rest(joint: yourdfpy.Joint, t_links: dict[str, Array]) -> Array:
    """Unit axis (3,) of a joint."""
    axis: Array = t_links[joint.child][:3, :3] @ joint.axis
    return axis / np.linalg.norm(axis)


def limits_of(path: Path, joint: yourdfpy.Joint) -> tuple[float, float]:
    """Lower and upper limit; infinite where none is given."""
    limit = joint.limit
    if joint.type == "continuous" or limit is None or (limit.lower is None and limit.upper is None):
        return (-np.inf, np.inf)
    lower, upper = limit.lower or 0.0, limit.upper or 0.0
    if lower > upper:
        raise InputError(f"{path}: joint '{joint.name}' has its lower limit above its upper; exchange them")
    return lower, upper
