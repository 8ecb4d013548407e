"""A URDF file as a body: any tree of revolute, continuous, prismatic and fixed joints.

In the rest pose all joints are zero, the z axis of the base link is up and its x axis points to the camera,
so that a robot faces the camera like a person at rest. The root has the usual six degrees of freedom. Joints
keep their names. Links connected by fixed joints are merged.
"""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree as ET

import msgspec
import numpy as np
import yourdfpy

from gepf.common.arrays import Array
from gepf.common.body import (
    REST_FROM_URDF,
    ROOT_DOFS,
    ROTATION,
    TRANSLATION,
    BodyModel,
    find_balls,
    surface_carriers,
)
from gepf.common.camera import rigid
from gepf.common.errors import InputError
from gepf.coordinator.bodies.robot_surface import joined, link_surfaces, load_urdf

XACRO = "http://www.ros.org/wiki/xacro"

logger = logging.getLogger(__name__)

MOVING = {"revolute": ROTATION, "continuous": ROTATION, "prismatic": TRANSLATION}
BASE = len(ROOT_DOFS) - 1
FLAT_SPREAD = 8.0  # of `rest_spreads`: 13 rad by default, so poses within the limits are equally likely


class Extents(msgspec.Struct, frozen=True):
    """Usual extents of bodies that are tracked in a room; others are probably in the wrong unit."""

    min_m: float = 0.02
    max_m: float = 10.0


EXTENTS = Extents()


def read_urdf(path: Path) -> BodyModel:
    """The body of a URDF file; InputError if the file is invalid or the body cannot be tracked."""
    if not path.is_file():
        raise InputError(f"no such file: {path}; give --model human or a URDF file")
    check_text(path)
    robot = load_urdf(path, build_scene_graph=False, load_meshes=False).robot
    check_joints(path, robot)
    base, joints, t_links, dof_of = span_tree(path, robot)
    moving = [joint for joint in joints if joint.type in MOVING]

    carried = link_surfaces(path, t_links)
    surface = joined(list(carried.values()))
    if not EXTENTS.min_m < (size := float(np.ptp(surface.vertices, axis=0).max())) < EXTENTS.max_m:
        logger.warning("%s: the body is %.3g m large at rest; check the scale of its meshes", path, size)
    owners = np.repeat([dof_of[link] for link in carried], [len(part.vertices) for part in carried.values()])
    skin_links, skin_weights = (owners - BASE)[:, None].astype(np.int64), np.ones((len(owners), 1))
    kinds = np.array([TRANSLATION] * 3 + [ROTATION] * 3 + [MOVING[j.type] for j in moving], dtype=np.int64)
    parents = np.array([*range(-1, BASE), *(dof_of[j.parent] for j in moving)], dtype=np.int64)
    own_axes = [t_links[j.child][:3, :3] @ j.axis for j in moving]
    axes = np.array([*np.eye(3), *np.eye(3), *(axis / np.linalg.norm(axis) for axis in own_axes)])
    points = np.array([*np.zeros((6, 3)), *(t_links[j.child][:3, 3] for j in moving)])
    link_dofs = np.arange(BASE, len(kinds), dtype=np.int64)
    return BodyModel(
        name=robot.name,
        dof_names=(*ROOT_DOFS, *(j.name for j in moving)),
        kinds=kinds,
        parents=parents,
        axes=axes,
        points=points,
        rest_spreads=np.full(len(kinds), FLAT_SPREAD),
        limits=np.array([(-np.inf, np.inf)] * 6 + [limits_of(path, j) for j in moving]),
        balls=find_balls(kinds, parents, axes, points, surface_carriers(link_dofs, skin_links, skin_weights)),
        link_names=(base, *(j.child for j in moving)),
        link_dofs=link_dofs,
        vertices=np.asarray(surface.vertices),
        triangles=np.asarray(surface.faces, dtype=np.int64),
        skin_links=skin_links,
        skin_weights=skin_weights,
        joint_names=(base, *(j.name for j in joints)),
        joint_links=np.array([0, *(dof_of[j.child] - BASE for j in joints)], dtype=np.int64),
        joint_points=np.array([t_links[base][:3, 3], *(t_links[j.child][:3, 3] for j in joints)]),
    )


def check_text(path: Path) -> None:
    """InputError if the text is not XML, not a robot, or an unexpanded xacro file."""
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, LookupError, ValueError) as error:
        raise InputError(f"{path} is not a URDF file: its XML is damaged ({error}); copy it again") from None
    if root.tag != "robot":
        raise InputError(f"{path} is not a URDF file: its root is <{root.tag}>, not <robot>; give another")
    if any(XACRO in str(part.tag) or "${" in "".join(part.attrib.values()) for part in root.iter()):
        raise InputError(f"{path} contains xacro macros; run xacro {path.name} > robot.urdf, and give that")


def check_joints(path: Path, robot: yourdfpy.Robot) -> None:
    """InputError for joints that cannot be tracked."""
    for joint in robot.joints:
        if joint.type not in {*MOVING, "fixed"}:
            raise InputError(f"{path}: joint '{joint.name}' is {joint.type}; make it fixed or revolute")
        if joint.mimic is not None and joint.mimic.joint:
            logger.warning(
                "%s: '%s' mimics '%s', but is tracked independently", path, joint.name, joint.mimic.joint
            )
        if joint.type in MOVING and not np.linalg.norm(joint.axis) > 0.0:
            raise InputError(f"{path}: the axis of joint '{joint.name}' is zero; give it a direction")


class Tree(NamedTuple):
    """The links and joints of a robot at rest: all joints are at zero."""

    base: str  # the link that no joint moves
    joints: list[yourdfpy.Joint]  # parents first
    t_links: dict[str, Array]  # T_rest_link (4, 4) by link
    dof_of: dict[str, int]  # by link: the last degree of freedom that moves it


def span_tree(path: Path, robot: yourdfpy.Robot) -> Tree:
    """The tree of a robot; InputError if its joints are not a tree, or a name occurs twice."""
    children, links = {joint.child for joint in robot.joints}, [link.name for link in robot.links]
    base = next((link for link in links if link not in children), "")
    joints, t_links, dof_of = list[yourdfpy.Joint](), {base: rigid(REST_FROM_URDF, np.zeros(3))}, {base: BASE}
    dofs, waiting = BASE, list(robot.joints)
    while ready := next((joint for joint in waiting if joint.parent in t_links), None):
        waiting.remove(ready)
        dofs += ready.type in MOVING
        joints.append(ready)
        origin = np.eye(4) if ready.origin is None else ready.origin
        t_links[ready.child] = t_links[ready.parent] @ origin
        dof_of[ready.child] = dofs if ready.type in MOVING else dof_of[ready.parent]
    if waiting or set(t_links) != set(links) or len(joints) != len(links) - 1:
        raise InputError(f"{path}: links and joints are not one tree; each link except one needs one parent")
    names = Counter([*ROOT_DOFS, base, *(joint.name for joint in robot.joints)])
    twice = [name for name, count in names.items() if count > 1]
    if twice:
        raise InputError(f"{path}: the name '{twice[0]}' is used twice; give every joint its own name")
    return Tree(base, joints, t_links, dof_of)


def limits_of(path: Path, joint: yourdfpy.Joint) -> tuple[float, float]:
    """Lower and upper limit; infinite if missing."""
    limit = joint.limit
    if joint.type == "continuous" or limit is None or (limit.lower is None and limit.upper is None):
        return (-np.inf, np.inf)
    lower, upper = limit.lower or 0.0, limit.upper or 0.0
    if lower > upper:
        raise InputError(f"{path}: joint '{joint.name}' has its lower limit above its upper; swap them")
    return lower, upper
