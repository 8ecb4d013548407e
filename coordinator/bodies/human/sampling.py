"""A surface sampled evenly: corners as dense as large faces, whatever the triangles it came as.

Correspondences go to vertices. A box has eight, a rounded edge from a CAD program a thousand: neither can
be tracked as it is. Long edges are split, then vertices that lie close together on one side of the surface
become one. Kept vertices stay where they were; corners and sharp edges are kept first.
"""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Triangles = NDArray[np.int64]

VERTICES = 4_500  # about as many as a whole body is to have
EVEN_ENOUGH = (2_500, 7_500)
SHARP = np.radians(30.0)
SPLIT, CLOSE = 1.3, 0.55  # longest edge and least distance, in spacings
FINEST = 0.001  # metres between vertices, of the smallest body


def sample_evenly(parts: list[trimesh.Trimesh], wanted: int = VERTICES) -> list[trimesh.Trimesh]:
    """Parts of one body, of about `wanted` vertices together; as they are where they are even already."""
    whole = [merged(part.vertices, part.faces) for part in parts]
    spacing = np.sqrt(1.3 * sum(part.area for part in whole) / wanted)
    if is_even(whole, spacing):
        return whole
    for _ in range(3):
        spacing = max(spacing, FINEST)
        sampled = [resample(part, spacing) for part in whole]
        count = sum(len(part.vertices) for part in sampled)
        if spacing == FINEST or 0.8 * wanted < count < 1.2 * wanted:
            break
        spacing *= np.sqrt(count / wanted)
    return sampled


def is_even(parts: list[trimesh.Trimesh], spacing: float) -> bool:
    """Whether there are enough vertices, not too many, and no edges across large faces."""
    least, most = EVEN_ENOUGH
    edges = np.concatenate([part.edges_unique_length for part in parts])
    return bool(
        least <= sum(len(part.vertices) for part in parts) <= most and edges.max() < 3.0 * SPLIT * spacing
    )


def merged(vertices: Array, faces: Triangles) -> trimesh.Trimesh:
    """Equal vertices made one, without triangles that have no area and vertices that have no triangle."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return mesh


def resample(mesh: trimesh.Trimesh, spacing: float) -> trimesh.Trimesh:
    """The mesh with neighbouring vertices about `spacing` metres apart."""
    vertices, faces = trimesh.remesh.subdivide_to_size(  # type: ignore[no-untyped-call]
        mesh.vertices, mesh.faces, max_edge=SPLIT * spacing, max_iter=20
    )
    fine = merged(vertices, faces)
    place = np.hstack([fine.vertices, spacing * fine.vertex_normals])  # the sides of a plate lie apart
    kept = thin_out(place, importance(fine), CLOSE * spacing)
    nearest = cKDTree(place[kept]).query(place)[1]
    return merged(fine.vertices[kept], nearest[fine.faces])


def importance(mesh: trimesh.Trimesh) -> NDArray[np.int64]:
    """2 for corners (V,), 1 on sharp edges, 0 elsewhere."""
    sharp = mesh.face_adjacency_edges[mesh.face_adjacency_angles > SHARP]
    count = np.bincount(sharp.ravel(), minlength=len(mesh.vertices))
    return np.select([count > 2, count > 0], [2, 1], 0)


def thin_out(points: Array, important: NDArray[np.int64], distance: float) -> NDArray[np.int64]:
    """Indices, ascending, of points (n, k), no two of them closer than `distance`, that all are near to."""
    order = np.argsort(-important, kind="stable")
    neighbours = cKDTree(points).query_ball_point(points, distance)
    gone = np.zeros(len(points), dtype=bool)
    kept = []
    for i in order:
        if not gone[i]:
            kept.append(i)
            gone[neighbours[i]] = True
    return np.sort(np.array(kept, dtype=np.int64))
