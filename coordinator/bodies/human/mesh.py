"""Triangle surfaces with evenly spaced vertices: of a signed distance, and of any given mesh.

A person is the surface of a signed distance (marching cubes, then nearly even spacing). The body is the
mirror image of itself, so only its left half is meshed; vertices on the mirror plane are shared. The result
is the same, byte by byte, for the same distances.

A robot's meshes are sampled anew, as correspondences go to vertices: a box has eight, a rounded edge from a
CAD program a thousand, and neither can be tracked as it is. Long edges are split, then vertices that lie
close together on one side of the surface become one. Kept vertices stay where they were; corners and sharp
edges are kept first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

if TYPE_CHECKING:
    import trimesh

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Distance = Callable[[Array], Array]

ROUNDS, SHARE_OF_THE_WAY = 12, 0.5


def mesh_symmetric(distance: Distance, low: Array, high: Array, cell: float) -> tuple[Array, Indices]:
    """Vertices (V, 3) and triangles (T, 3), counter-clockwise from outside.

    `low` and `high` bound the left half, x >= 0.
    """
    half, triangles = _mesh_half(distance, low, high, cell)
    vertices, triangles, mirror = _mirrored(half, triangles)
    return _evened(distance, vertices, triangles, mirror, 0.3 * cell), triangles


def _mesh_half(distance: Distance, low: Array, high: Array, cell: float) -> tuple[Array, Indices]:
    counts = np.ceil((high - low) / cell).astype(np.int64) + 1
    axes = [low[a] + cell * np.arange(counts[a]) for a in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = distance(grid).reshape(counts)
    values[np.abs(values) < 1e-3 * cell] = 1e-3 * cell
    corners, triangles, _, _ = marching_cubes(values, 0.0, spacing=(cell,) * 3, gradient_direction="descent")  # type: ignore[no-untyped-call]
    return corners.astype(np.float64) + low, triangles.astype(np.int64)


def _mirrored(half: Array, triangles: Indices) -> tuple[Array, Indices, Indices]:
    seam = half[:, 0] < 1e-9
    count = len(half)
    image = np.where(seam, np.arange(count), count - 1 + np.cumsum(~seam))
    vertices = np.concatenate([half, half[~seam] * (-1.0, 1.0, 1.0)])
    both = np.concatenate([triangles, image[triangles][:, ::-1]])
    mirror = np.concatenate([image, np.flatnonzero(~seam)])
    return vertices, both, mirror


def _evened(distance: Distance, vertices: Array, triangles: Indices, mirror: Indices, delta: float) -> Array:
    """Vertices moved along the surface to the middle of their neighbours, and back onto the surface."""
    neighbours = _neighbours(triangles, len(vertices))
    left = mirror >= np.arange(len(mirror))
    for _ in range(ROUNDS):
        moved = vertices + SHARE_OF_THE_WAY * (neighbours @ vertices - vertices)
        vertices = _mirror_of(_onto_surface(distance, moved[left], delta), left, mirror)
    return vertices


def _mirror_of(half: Array, left: NDArray[np.bool_], mirror: Indices) -> Array:
    vertices = np.empty((len(mirror), 3))
    vertices[mirror[left]] = half * (-1.0, 1.0, 1.0)
    vertices[left] = half
    vertices[mirror == np.arange(len(mirror)), 0] = 0.0
    return vertices


def _neighbours(triangles: Indices, count: int) -> coo_array:
    """Sparse (V, V) that averages over each vertex's neighbours."""
    rows = triangles.ravel()
    columns = np.roll(triangles, -1, axis=1).ravel()
    ring = coo_array((np.ones(len(rows)), (rows, columns)), shape=(count, count)).tocsr()
    degree = np.asarray(ring.sum(axis=1)).reshape(-1, 1)
    return ring.multiply(1.0 / degree).tocsr()


def _onto_surface(distance: Distance, points: Array, delta: float) -> Array:
    """One Newton step onto the surface along the gradient, at most `delta` long."""
    gradient = slope(distance, points, delta)
    square = np.maximum(np.sum(gradient**2, axis=1), 0.1)
    step = np.clip(distance(points) / square, -2.0 * delta, 2.0 * delta)
    return np.asarray(points - step[:, None] * gradient)


def slope(distance: Distance, points: Array, delta: float) -> Array:
    """The gradient (n, 3) of the distance at points (n, 3), by differences."""
    ends = np.concatenate([points + delta * e for e in (*np.eye(3), *-np.eye(3))])
    values = distance(ends).reshape(6, -1)
    return np.asarray((values[:3] - values[3:]).T / (2.0 * delta))


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
    import trimesh  # takes half a second, and people need none of it

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    return mesh


def resample(mesh: trimesh.Trimesh, spacing: float) -> trimesh.Trimesh:
    """The mesh with neighbouring vertices about `spacing` metres apart."""
    import trimesh

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
