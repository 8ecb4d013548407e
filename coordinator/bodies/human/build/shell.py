"""A closed shell around a surface that may have holes and cavities, as a signed distance."""

from __future__ import annotations

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

STEP_M = 0.006  # of the grid that tells outside from inside
MARGIN_M = 0.06


class Shell:
    """All points that are `thickness` (m) outside a surface.

    Args:
        vertices: (N, 3) metres.
        triangles: (T, 3).
        thickness: More than half a grid step.
    """

    def __init__(self, vertices: Array, triangles: Indices, thickness: float) -> None:
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(vertices.astype(np.float32), triangles.astype(np.uint32))
        self._thickness = thickness
        used = vertices[np.unique(triangles)]
        self.low, self.high = used.min(axis=0) - MARGIN_M, used.max(axis=0) + MARGIN_M
        counts = np.ceil((self.high - self.low) / STEP_M).astype(np.int64) + 1
        grid = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), axis=-1)
        free = self._distance(self.low + STEP_M * grid.reshape(-1, 3)).reshape(counts) > thickness
        regions = label(free)[0]
        nearest = distance_transform_edt(~free, return_distances=False, return_indices=True)
        self._outside = (regions == regions[0, 0, 0])[tuple(nearest)]

    def distance(self, points: Array) -> Array:
        """Signed distances (n,) of points (n, 3) from the shell, negative inside."""
        cell = np.clip(np.rint((points - self.low) / STEP_M).astype(np.int64), 0, np.array(self._outside.shape) - 1)
        distance = self._distance(points)
        return np.where(self._outside[tuple(cell.T)], distance, -distance) - self._thickness

    def closest(self, points: Array) -> tuple[Indices, Array]:
        """The nearest triangle (n,) of each point (n, 3), and its barycentric coordinates (n, 3) there."""
        found = self._scene.compute_closest_points(points.astype(np.float32), nthreads=1)
        uv = found["primitive_uvs"].numpy().astype(np.float64)
        return found["primitive_ids"].numpy().astype(np.int64), np.column_stack([1.0 - uv.sum(axis=1), uv])

    def _distance(self, points: Array) -> Array:
        return np.asarray(self._scene.compute_distance(points.astype(np.float32), nthreads=1).numpy(), dtype=np.float64)
