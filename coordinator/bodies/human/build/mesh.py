"""The surface of a signed distance as triangles with nearly evenly spaced vertices, by marching cubes.

The body is symmetric, so only its left half is meshed; vertices on the mirror plane are shared. The same
distances give the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array
from skimage.measure import marching_cubes

from common.arrays import Array, Indices

Distance = Callable[[Array], Array]
MIRRORED = np.array([-1.0, 1.0, 1.0])


def mesh_symmetric(
    distance: Distance, low: Array, high: Array, cell: float
) -> tuple[Array, Indices, Indices]:
    """Vertices (V, 3), triangles (T, 3) counter-clockwise from outside, and mirror images (V,).

    `low` and `high` bound the left half, x >= 0.
    """
    counts = np.ceil((high - low) / cell).astype(np.int64) + 1
    axes = [low[a] + cell * np.arange(counts[a]) for a in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    values = distance(grid).reshape(counts)
    values[np.abs(values) < 1e-3 * cell] = 1e-3 * cell
    corners, faces, _, _ = marching_cubes(values, 0.0, spacing=(cell,) * 3, gradient_direction="descent")  # type: ignore[no-untyped-call]
    half, faces = corners.astype(np.float64) + low, faces.astype(np.int64)
    seam, count = half[:, 0] < 1e-9, len(half)
    image = np.where(seam, np.arange(count), count - 1 + np.cumsum(~seam))
    mirror = np.concatenate([image, np.flatnonzero(~seam)])
    vertices = np.concatenate([half, half[~seam] * MIRRORED])
    triangles = np.concatenate([faces, image[faces][:, ::-1]])
    # vertices move along the surface to the mean of their neighbours
    edges = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    ring = coo_array((np.ones(len(edges[0])), edges), shape=(len(vertices), len(vertices))).tocsr()
    mean = ring.multiply(1.0 / np.asarray(ring.sum(axis=1)).reshape(-1, 1)).tocsr()
    left = mirror >= np.arange(len(mirror))
    for _ in range(12):
        moved = vertices + 0.5 * (mean @ vertices - vertices)
        vertices[left] = _onto_surface(distance, moved[left], 0.3 * cell)
        vertices[mirror[left]] = vertices[left] * MIRRORED
        vertices[mirror == np.arange(len(mirror)), 0] = 0.0
    return vertices, triangles, mirror


def _onto_surface(distance: Distance, points: Array, delta: float) -> Array:
    """One Newton step of points (n, 3) onto the surface along the gradient, by differences of `delta`."""
    ends = np.concatenate([points + delta * e for e in (*np.eye(3), *-np.eye(3))])
    values = distance(ends).reshape(6, -1)
    gradient = np.asarray((values[:3] - values[3:]).T / (2.0 * delta))
    square = np.maximum(np.sum(gradient**2, axis=1), 0.1)
    step = np.clip(distance(points) / square, -2.0 * delta, 2.0 * delta)
    return np.asarray(points - step[:, None] * gradient)
