"""A closed, smooth shell around a surface that may have holes and cavities, as a signed distance."""

from __future__ import annotations

import numpy as np
import open3d as o3d
from scipy.ndimage import label
from skimage.measure import marching_cubes

from common.arrays import Array, Indices

_tensor = o3d.core.Tensor.from_numpy

STEP_M = 0.006  # of the grid that tells outside from inside
MARGIN_M = 0.06


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
        self.low, self.high = used.min(axis=0) - MARGIN_M, used.max(axis=0) + MARGIN_M
        counts = np.ceil((self.high - self.low) / STEP_M).astype(np.int64) + 1
        grid = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1)
        distance = _distance(self._surface, self.low + STEP_M * grid.reshape(-1, 3)).reshape(counts)
        regions = label(distance > reach)[0]
        self._outside = regions == regions[0, 0, 0]
        values = np.where((regions > 0) & ~self._outside, 0.0, distance)
        corners, faces, _, _ = marching_cubes(values, reach, spacing=(STEP_M,) * 3)  # type: ignore[no-untyped-call]
        self._far = _scene(corners + self.low, faces)
        self._gap = reach - thickness

    def distance(self, points: Array) -> Array:
        """Signed distances (n,) of points (n, 3) from the shell, negative inside."""
        last = np.array(self._outside.shape) - 1
        cell = np.clip(np.rint((points - self.low) / STEP_M).astype(np.int64), 0, last)
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
