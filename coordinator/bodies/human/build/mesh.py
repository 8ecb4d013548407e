"""The surface of a signed distance as triangles with nearly evenly spaced vertices, by marching cubes.

The body is symmetric, so only its left half is meshed; vertices on the mirror plane are shared. The same
distances give the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array
from skimage.measure import marching_cubes

from common.arrays import Array, Indices, Mask

Distance = Callable[[Array], Array]


def mesh_symmetric(
    distance: Distance, low: Array, high: Array, cell: float
) -> tuple[Array, Indices, Indices]:
    """Vertices (V, 3), triangles (T, 3) counter-clockwise from outside, and mirror images (V,).

    `low` and `high` bound the left half, x >= 0.
    """
    half, triangles = _mesh_half(distance, low, high, cell)
    vertices, triangles, mirror = _mirrored(half, triangles)
    return _evened(distance, vertices, triangles, mirror, 0.3 * cell), triangles, mirror


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
    """Move vertices along the surface to the mean of their neighbours, and back onto the surface."""
    neighbours = _neighbours(triangles, len(vertices))
    left = mirror >= np.arange(len(mirror))
    for _ in range(12):
        moved = vertices + 0.5 * (neighbours @ vertices - vertices)
        vertices = _mirror_of(_onto_surface(distance, moved[left], delta), left, mirror)
    return vertices


def _mirror_of(half: Array, left: Mask, mirror: Indices) -> Array:
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
    """The gradient (n, 3) of the distance at points (n, 3), by finite differences."""
    ends = np.concatenate([points + delta * e for e in (*np.eye(3), *-np.eye(3))])
    values = distance(ends).reshape(6, -1)
    return np.asarray((values[:3] - values[3:]).T / (2.0 * delta))
