"""A body as a URDF file with a mesh for each link beside it: the inverse of reading.

URDF knows rigid links only: of a blended skin each triangle goes with the link that most of it follows,
so the surface is the same at rest and creases where joints bend. A joint of several degrees of freedom
becomes a chain; named joints that are no degree of freedom become fixed frames. The root is left out, as
a URDF says nothing of where its base is.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np
import trimesh
import yourdfpy
from numpy.typing import NDArray

from common.body import ROOT_DOFS, ROTATION, BodyModel
from common.errors import InputError
from coordinator.bodies.urdf import REST_FROM_URDF

Array = NDArray[np.float64]

MESHES = "meshes"
FARTHEST_SLIDE = 1000.0  # metres: URDF has no prismatic joint without limits
EFFORT, VELOCITY = 100.0, 10.0  # which URDF asks for and nothing here needs


def write_urdf(model: BodyModel, path: Path) -> None:
    """Write `path` and meshes/*.stl beside it. InputError if it cannot be written."""
    owners = triangle_owners(model)
    names = name_links(model)
    links = {name: yourdfpy.Link(name=name) for name in names.values()}
    try:
        (path.parent / MESHES).mkdir(parents=True, exist_ok=True)
        for dof, name in names.items():
            mesh = surface_of(model, owners == dof, frame_point(model, dof))
            if mesh is not None:
                file = f"{MESHES}/{path.stem}_{name}.stl"
                mesh.export(path.parent / file)
                links[name].visuals.append(
                    yourdfpy.Visual(geometry=yourdfpy.Geometry(mesh=yourdfpy.Mesh(filename=file)))
                )
        joints = [moving_joint(model, dof, names) for dof in names if dof >= base_dof(model) + 1]
        for j, name in enumerate(model.joint_names):
            if name not in model.dof_names and name != names[base_dof(model)]:
                frame = free_name(f"{name}_frame", links)
                links[frame] = yourdfpy.Link(name=frame)
                joints.append(fixed_joint(model, j, frame, names))
        robot = yourdfpy.Robot(name=model.name, links=list(links.values()), joints=joints)
        urdf = yourdfpy.URDF(
            robot,
            build_scene_graph=False,
            load_meshes=False,
            filename_handler=yourdfpy.urdf.filename_handler_null,
        )
        urdf.write_xml_file(str(path))
    except OSError as error:
        raise InputError(f"cannot write {path} ({error.strerror}); choose another place") from error


def base_dof(model: BodyModel) -> int:
    """The last degree of freedom of the root, -1 for a body that stays."""
    return max((model.dof_names.index(name) for name in ROOT_DOFS if name in model.dof_names), default=-1)


def rooted(model: BodyModel, dof: int) -> int:
    """`dof`, or the base's where it belongs to the root."""
    return max(dof, base_dof(model))


def name_links(model: BodyModel) -> dict[int, str]:
    """A link for every degree of freedom beyond the root, and the base; named as in the model if there."""
    names: dict[int, str] = {}
    own = {rooted(model, int(d)): name for d, name in zip(model.link_dofs, model.link_names, strict=True)}
    for dof in range(base_dof(model), len(model.dof_names)):
        wanted = own.get(dof, "base" if dof < 0 else f"{model.dof_names[dof]}_link")
        names[dof] = free_name(wanted, names.values())
    return names


def free_name(wanted: str, taken: Collection[str]) -> str:
    """`wanted`, with underscores added until the name is free."""
    while wanted in taken:
        wanted += "_"
    return wanted


def triangle_owners(model: BodyModel) -> NDArray[np.int64]:
    """The degree of freedom (T,) whose link each triangle goes with: its vertices' heaviest."""
    dofs = np.maximum(model.link_dofs, base_dof(model))[model.skin_links[model.triangles]]  # (T, 3, K)
    weights = model.skin_weights[model.triangles]
    share = np.zeros((len(model.triangles), len(model.dof_names) + 1))
    rows = np.arange(len(share))[:, None, None]
    np.add.at(share, (rows, dofs + 1), weights)
    owners: NDArray[np.int64] = np.argmax(share, axis=1) - 1
    return owners


def frame_point(model: BodyModel, dof: int) -> Array:
    """The origin (3,) of a link's frame at rest: on its joint, or the base's."""
    return np.zeros(3) if dof <= base_dof(model) else model.points[dof]


def surface_of(model: BodyModel, chosen: NDArray[np.bool_], origin: Array) -> trimesh.Trimesh | None:
    """The triangles chosen (T,) in a link's frame, None for none."""
    if not chosen.any():
        return None
    used, triangles = np.unique(model.triangles[chosen], return_inverse=True)
    vertices = (model.vertices[used] - origin) @ REST_FROM_URDF
    return trimesh.Trimesh(vertices, triangles.reshape(-1, 3), process=False)


def moving_joint(model: BodyModel, dof: int, names: dict[int, str]) -> yourdfpy.Joint:
    """A degree of freedom as a joint."""
    parent = rooted(model, int(model.parents[dof]))
    lower, upper = model.limits[dof]
    rotates = model.kinds[dof] == ROTATION
    if rotates and np.isinf([lower, upper]).any():
        kind, limit = "continuous", None
    else:
        kind = "revolute" if rotates else "prismatic"
        lower, upper = np.clip([lower, upper], -FARTHEST_SLIDE, FARTHEST_SLIDE).tolist()
        limit = yourdfpy.Limit(effort=EFFORT, velocity=VELOCITY, lower=lower, upper=upper)
    return yourdfpy.Joint(
        name=model.dof_names[dof],
        type=kind,
        parent=names[parent],
        child=names[dof],
        origin=shifted(frame_point(model, dof) - frame_point(model, parent)),
        axis=model.axes[dof] @ REST_FROM_URDF,
        limit=limit,
    )


def fixed_joint(model: BodyModel, j: int, frame: str, names: dict[int, str]) -> yourdfpy.Joint:
    """A named joint as a frame on its link."""
    dof = rooted(model, int(model.link_dofs[model.joint_links[j]]))
    return yourdfpy.Joint(
        name=model.joint_names[j],
        type="fixed",
        parent=names[dof],
        child=frame,
        origin=shifted(model.joint_points[j] - frame_point(model, dof)),
    )


def shifted(offset: Array) -> Array:
    """(4, 4) of a frame at `offset` (3,), given at rest, with its parent's axes."""
    placed = np.eye(4)
    placed[:3, 3] = offset @ REST_FROM_URDF
    return placed
