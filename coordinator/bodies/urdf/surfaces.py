"""The surfaces of a robot's links at rest, from the meshes and shapes of its URDF file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from common.errors import InputError
from coordinator.bodies.urdf.loading import load

Array = NDArray[np.float64]


def surfaces(path: Path, t_links: dict[str, Array]) -> dict[str, trimesh.Trimesh]:
    """The surface of every link that has one, at rest: what is seen, or else what is for collisions."""
    found = surfaces_in(load(path).scene, t_links)
    if not found:
        shapes = load(
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
