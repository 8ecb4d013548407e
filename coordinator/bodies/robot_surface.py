"""The surfaces of a URDF's links, with evenly spaced vertices.

Correspondences refer to vertices. A box has eight, and a rounded edge from a CAD program has a thousand;
neither is suitable. Long edges are split, then nearby vertices on one side of the surface are merged.
Remaining vertices are not moved; corners and sharp edges have priority.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import msgspec
import numpy as np
import trimesh
import yourdfpy
from scipy.spatial import cKDTree

from gepf.common.arrays import Array, Indices
from gepf.common.errors import InputError


class SurfaceSettings(msgspec.Struct, frozen=True):
    """How densely a surface is sampled."""

    vertices: int = 4_500  #: of a whole body, about
    sharp_deg: float = 30.0  #: angle between triangles at an edge that is kept
    longest_edge: float = 1.3  #: in spacings of vertices
    least_distance: float = 0.55  #: the same


SURFACE = SurfaceSettings()


def link_surfaces(path: Path, t_links: dict[str, Array]) -> dict[str, trimesh.Trimesh]:
    """The surface of every link that has one, at rest: the visual geometry, or else the collision geometry.

    `t_links` are T_rest_link (4, 4). Raises InputError if a mesh is missing, or there is none.
    """
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
        raise InputError(f"{path} has no surface; give its links <visual> meshes, boxes or cylinders")
    spacing = np.sqrt(1.3 * sum(part.area for part in found.values()) / SURFACE.vertices)
    return {link: resample(part, spacing) for link, part in found.items()}


def load_urdf(path: Path, **what: bool) -> yourdfpy.URDF:
    """The parsed file, with the parts `what` that yourdfpy loads; InputError for any error.

    Meshes have the scale of the file times the unit that they state themselves, as in ROS.
    """
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)  # errors are raised here
    handler = partial(find_mesh, path=path)
    try:
        robot = yourdfpy.URDF.load(
            str(path), build_scene_graph=False, load_meshes=False, filename_handler=handler
        ).robot
        for mesh in meshes_of(robot, **what):
            unit = unit_of(Path(find_mesh(mesh.filename, path)))
            if unit != 1.0:
                mesh.scale = unit * np.broadcast_to(1.0 if mesh.scale is None else mesh.scale, 3)
        return yourdfpy.URDF(robot=robot, filename_handler=handler, **what)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{path} is not a valid URDF ({type(error).__name__}: {error}); check it") from error


def meshes_of(
    robot: yourdfpy.Robot, *, load_meshes: bool = True, load_collision_meshes: bool = False, **_: bool
) -> Iterator[yourdfpy.Mesh]:
    """The meshes of all links that are loaded."""
    for link in robot.links:
        parts = link.visuals if load_meshes else []
        for part in parts + (link.collisions if load_collision_meshes else []):
            if part.geometry is not None and part.geometry.mesh is not None:
                yield part.geometry.mesh


def unit_of(mesh: Path) -> float:
    """Metres of one unit of a mesh: as a Collada file states it (`<unit meter="0.01"/>`), else 1."""
    if mesh.suffix.lower() != ".dae":
        return 1.0
    for _, part in ET.iterparse(mesh):
        if part.tag.rpartition("}")[2] == "unit":
            return float(part.get("meter", "1"))
    return 1.0


def find_mesh(fname: str, path: Path) -> str:
    """The path of a mesh: as named, or below the URDF's folder or its parents, without the package."""
    found: str = yourdfpy.urdf.filename_handler_magic(fname, str(path.parent.absolute()))
    if not Path(found).is_file():
        raise InputError(f"{path} names the mesh {fname}, which does not exist; add it or correct the name")
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
    return {link: joined(found[link]) for link in t_links if link in found}


def joined(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """All parts as one surface, in their order."""
    surface: Any = trimesh.util.concatenate(parts)
    return trimesh.Trimesh(surface.vertices, surface.faces, process=False)


def outside_out(mesh: trimesh.Trimesh, transform: Array) -> trimesh.Trimesh:
    """The transformed mesh; counter-clockwise from outside if it is closed."""
    bare = trimesh.Trimesh(np.asarray(mesh.vertices), np.asarray(mesh.faces), process=True)
    bare.apply_transform(transform)
    if bare.is_watertight:
        bare.fix_normals()
    return bare


def resample(mesh: trimesh.Trimesh, spacing: float) -> trimesh.Trimesh:
    """The mesh with neighbouring vertices about `spacing` metres apart."""
    vertices, faces = trimesh.remesh.subdivide_to_size(  # type: ignore[no-untyped-call]
        mesh.vertices, mesh.faces, max_edge=SURFACE.longest_edge * spacing, max_iter=20
    )
    fine = merged(vertices, faces)
    place = np.hstack([fine.vertices, spacing * fine.vertex_normals])  # separates the sides of a plate
    sharp = fine.face_adjacency_edges[fine.face_adjacency_angles > np.radians(SURFACE.sharp_deg)]
    corners_first = np.argsort(-np.bincount(sharp.ravel(), minlength=len(place)), kind="stable")
    kept = thin_out(place, corners_first, SURFACE.least_distance * spacing)
    nearest = cKDTree(place[kept]).query(place)[1]
    return merged(fine.vertices[kept], nearest[fine.faces])


def merged(vertices: Array, faces: Indices) -> trimesh.Trimesh:
    """Merge equal vertices; remove triangles without area and vertices without triangles."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return mesh


def thin_out(points: Array, order: Indices, distance: float) -> Indices:
    """Indices, ascending, of points (n, k) of which no two are closer than `distance`, chosen in `order`."""
    neighbours = cKDTree(points).query_ball_point(points, distance)
    gone, kept = np.zeros(len(points), dtype=bool), []
    for i in order:
        if not gone[i]:
            kept.append(i)
            gone[neighbours[i]] = True
    return np.sort(np.array(kept, dtype=np.int64))
