"""A URDF file as a body: any tree of revolute, continuous, prismatic and fixed joints.

The body's rest pose is the robot with all joints at zero, its base link's z axis up and its x axis towards
the camera, so that a robot stands and faces the camera as a person does at rest; its root has the usual
six degrees of freedom. Joints keep their names. Links that fixed joints hold together become one.
"""

from __future__ import annotations

import logging
from collections import Counter
from functools import partial
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import trimesh
import yourdfpy
from numpy.typing import NDArray

from common.body import ROOT_DOFS, ROTATION, TRANSLATION, BodyModel, find_balls, surface_carriers
from common.errors import InputError
from coordinator.bodies.human.mesh import sample_evenly

Array = NDArray[np.float64]

XACRO = "http://www.ros.org/wiki/xacro"
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
    robot = load_urdf(path, build_scene_graph=False, load_meshes=False).robot
    check_tree(path, robot)
    joints = in_tree_order(path, robot)
    t_links = place_links(robot, joints)
    moving = [joint for joint in joints if joint.type in MOVING]
    dof_of = assign_dofs(robot, joints, moving)

    carried = surfaces(path, t_links)
    sampled = sample_evenly(list(carried.values()))
    vertices, triangles = join(sampled)
    owners = np.repeat([dof_of[link] for link in carried], [len(part.vertices) for part in sampled])
    skin_links, skin_weights = (owners - BASE)[:, None].astype(np.int64), np.ones((len(owners), 1))
    kinds = np.array([TRANSLATION] * 3 + [ROTATION] * 3 + [MOVING[j.type] for j in moving], dtype=np.int64)
    parents = np.array([*range(-1, BASE), *(dof_of[j.parent] for j in moving)], dtype=np.int64)
    own_axes = [t_links[j.child][:3, :3] @ j.axis for j in moving]
    axes = np.array([*np.eye(3), *np.eye(3), *(axis / np.linalg.norm(axis) for axis in own_axes)])
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
        balls=find_balls(kinds, parents, axes, points, surface_carriers(link_dofs, skin_links, skin_weights)),
        link_names=(base, *(j.child for j in moving)),
        link_dofs=link_dofs,
        vertices=vertices,
        triangles=triangles,
        skin_links=skin_links,
        skin_weights=skin_weights,
        joint_names=(base, *(j.name for j in joints)),
        joint_links=np.array([0, *(dof_of[j.child] - BASE for j in joints)], dtype=np.int64),
        joint_points=np.array([t_links[base][:3, 3], *(t_links[j.child][:3, 3] for j in joints)]),
    )


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
    """The first link that is no other's child; no name where there is none."""
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


def limits_of(path: Path, joint: yourdfpy.Joint) -> tuple[float, float]:
    """Lower and upper limit; infinite where none is given."""
    limit = joint.limit
    if joint.type == "continuous" or limit is None or (limit.lower is None and limit.upper is None):
        return (-np.inf, np.inf)
    lower, upper = limit.lower or 0.0, limit.upper or 0.0
    if lower > upper:
        raise InputError(f"{path}: joint '{joint.name}' has its lower limit above its upper; exchange them")
    return lower, upper


def check_text(path: Path) -> None:
    """InputError for what is no XML, no robot, still to be expanded, or names links that are not there."""
    try:
        root = ET.parse(path).getroot()
    except ET.ParseError as error:
        raise InputError(f"{path} is no URDF: its XML is damaged ({error}); copy it again") from None
    except (LookupError, ValueError):
        return  # an encoding that the reader of URDF knows, or names
    if root.tag != "robot":
        raise InputError(f"{path} is no URDF: it is a <{root.tag}>, not a <robot>; give a robot's file")
    if any(XACRO in str(part.tag) or "${" in "".join(part.attrib.values()) for part in root.iter()):
        raise InputError(f"{path} holds xacro's macros; run xacro {path.name} > robot.urdf, and give that")
    links = {link.get("name") for link in root.iterfind("link")}
    for joint in root.iterfind("joint"):
        for side in ("parent", "child"):
            end = joint.find(side)
            if end is None or end.get("link") not in links:
                named = "no link" if end is None else f"the link '{end.get('link')}', which is not there"
                raise InputError(f"{path}: joint '{joint.get('name')}' has as {side} {named}; mend it")


def load_urdf(path: Path, **what: bool) -> yourdfpy.URDF:
    """The parsed file with `what` yourdfpy is to load of it; whatever goes wrong is the file's fault."""
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)  # what matters is raised here
    try:
        return yourdfpy.URDF.load(str(path), filename_handler=partial(find_mesh, path=path), **what)
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"{path} is no URDF that can be read ({type(error).__name__}: {error}); check the file"
        ) from error


def find_mesh(fname: str, path: Path) -> str:
    """Where a mesh is: as named, or below the URDF's folder or one above it, without its package."""
    found: str = yourdfpy.urdf.filename_handler_magic(fname, str(path.parent.absolute()))
    if not Path(found).is_file():
        raise InputError(f"{path} names the mesh {fname}, which is not there; put it beside or mend the name")
    return found


def surfaces(path: Path, t_links: dict[str, Array]) -> dict[str, trimesh.Trimesh]:
    """The surface of every link that has one, at rest: what is seen, or else what is for collisions."""
    found = surfaces_in(load_urdf(path).scene, t_links)
    if not found:
        shapes = load_urdf(
            path,
            load_meshes=False,
            build_collision_scene_graph=True,
            load_collision_meshes=True,
            force_collision_mesh=False,
        )
        found = surfaces_in(shapes.collision_scene, t_links)
    if not found:
        raise InputError(
            f"{path} has no surface to track; give its links <visual> meshes, boxes or cylinders"
        )
    return found


def surfaces_in(scene: trimesh.Scene, t_links: dict[str, Array]) -> dict[str, trimesh.Trimesh]:
    """The surface of every link that has one, at rest."""
    found: dict[str, list[trimesh.Trimesh]] = {}
    for node in scene.graph.nodes_geometry:
        link = scene.graph.transforms.parents[node]
        t_link_mesh, name = scene.graph.get(node, link)
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            found.setdefault(link, []).append(outside_out(mesh, t_links[link] @ t_link_mesh))
    return {link: unite(found[link]) for link in t_links if link in found}


def join(parts: list[trimesh.Trimesh]) -> tuple[Array, NDArray[np.int64]]:
    """Vertices (V, 3) and triangles (T, 3) of all parts."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    vertices = np.concatenate([part.vertices for part in parts])
    return vertices, np.concatenate(
        [np.asarray(part.faces, dtype=np.int64) + start for part, start in zip(parts, starts, strict=True)]
    )


def unite(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """One surface; where all parts are closed, without what is inside of them."""
    if len(parts) > 1 and all(part.is_volume for part in parts):
        union: trimesh.Trimesh = trimesh.boolean.union(parts)
        if union.is_volume:
            return union
    return trimesh.Trimesh(*join(parts), process=False)


def outside_out(mesh: trimesh.Trimesh, transform: Array) -> trimesh.Trimesh:
    """The mesh moved; counter-clockwise from outside where it is closed, so that there is an outside."""
    bare = trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), process=True)
    bare.apply_transform(transform)
    if bare.is_watertight:
        bare.fix_normals()
    return bare
