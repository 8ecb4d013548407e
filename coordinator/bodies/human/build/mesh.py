"""A closed, smooth shell around a surface with holes, and triangles of nearly even size on it.

The body is symmetric, so only its left half is meshed; vertices on the mirror plane are shared. The same
distances give the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np
import open3d as o3d
from scipy.ndimage import label
from scipy.sparse import coo_array
from skimage.measure import marching_cubes

from gepf.common.arrays import Array, Indices

_tensor = o3d.core.Tensor.from_numpy


class Grid(msgspec.Struct, frozen=True):
    """The grid that tells outside from inside."""

    step_m: float = 0.006
    margin_m: float = 0.06  #: around the surface


GRID = Grid()


class Shell:
    """The points outside a surface at a distance, after narrow gaps are closed.

    Points whose distance from the surface is `reach` are meshed; the shell is nearer by `reach - thickness`.

    Args:
        vertices: (N, 3) metres.
        triangles: (T, 3).
        thickness: Of the shell, metres.
        reach: Half the width of gaps that are closed, metres.
    """

    def __init__(self, vertices: Array, triangles: Indices, thickness: float, reach: float) -> None:
        self._surface = _scene(vertices, triangles)
        used = vertices[np.unique(triangles)]
        self.low, self.high = used.min(axis=0) - GRID.margin_m, used.max(axis=0) + GRID.margin_m
        counts = np.ceil((self.high - self.low) / GRID.step_m).astype(np.int64) + 1
        grid = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1)
        distance = _distance(self._surface, self.low + GRID.step_m * grid.reshape(-1, 3)).reshape(counts)
        regions = label(distance > reach)[0]
        self._outside = regions == regions[0, 0, 0]
        values = np.where((regions > 0) & ~self._outside, 0.0, distance)
        corners, faces, _, _ = marching_cubes(values, reach, spacing=(GRID.step_m,) * 3)  # type: ignore[no-untyped-call]
        self._far = _scene(corners + self.low, faces)
        self._gap = reach - thickness

    def distance(self, points: Array) -> Array:
        """Signed distances (n,) of points (n, 3) from the shell, negative inside."""
        last = np.array(self._outside.shape) - 1
        cell = np.clip(np.rint((points - self.low) / GRID.step_m).astype(np.int64), 0, last)
        distance = _distance(self._far, points)
        return self._gap + np.where(self._outside[tuple(cell.T)], distance, -distance)

    def closest(self, points: Array) -> tuple[Indices, Array]:
        """The nearest triangle (n,) of each point (n, 3), and its barycentric coordinates (n, 3) there."""
        found = self._surface.compute_closest_points(_tensor(points.astype(np.float32)), nthreads=1)
        uv = found["primitive_uvs"].numpy().astype(np.float64)
        return found["primitive_ids"].numpy().astype(np.int64), np.column_stack([1.0 - uv.sum(axis=1), uv])


def _scene(vertices: Array, triangles: Indices) -> o3d.t.geometry.RaycastingScene:
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(_tensor(vertices.astype(np.float32)), _tensor(triangles.astype(np.uint32)))
    return scene


def _distance(scene: o3d.t.geometry.RaycastingScene, points: Array) -> Array:
    found = scene.compute_distance(_tensor(points.astype(np.float32)), nthreads=1)
    return np.asarray(found.numpy(), dtype=np.float64)


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
