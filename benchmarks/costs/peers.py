"""Rigid point-to-point ICP of well-known libraries: the yardstick for one particle's cost.

Each moves the observed points onto the visible model points, which it is given ready made; the articulated
kernel has to find them first. All stop after a number of iterations, never earlier.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import small_gicp
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACH = 10.0  # metres; every observed point has a partner, as in the paper


def small_gicp_icp(observed: Array, model: Array, iterations: int) -> Callable[[], Any]:
    """small_gicp's ICP from arrays (P, 3) and (Q, 3): point clouds and k-d tree are part of it."""

    def align() -> Any:
        target = small_gicp.PointCloud(model)
        return _align(target, small_gicp.PointCloud(observed), small_gicp.KdTree(target), iterations)

    return align


def small_gicp_icp_prepared(observed: Array, model: Array, iterations: int) -> Callable[[], Any]:
    """small_gicp's ICP on point clouds and a k-d tree that stand ready."""
    target, source = small_gicp.PointCloud(model), small_gicp.PointCloud(observed)
    tree = small_gicp.KdTree(target)
    return lambda: _align(target, source, tree, iterations)


def _align(target: Any, source: Any, tree: Any, iterations: int) -> Any:
    result = small_gicp.align(
        target,
        source,
        tree,
        registration_type="ICP",
        max_correspondence_distance=REACH,
        num_threads=1,
        max_iterations=iterations,
        rotation_epsilon=0.0,
        translation_epsilon=0.0,
    )
    if result.iterations != iterations - 1:  # the number of the last one, from 0
        raise RuntimeError(f"small_gicp stopped after {result.iterations + 1} of {iterations} iterations")
    return result


def open3d_icp(observed: Array, model: Array, iterations: int) -> Callable[[], Any]:
    """Open3D's ICP on point clouds that stand ready; it builds its k-d tree every time."""
    import open3d

    registration = open3d.pipelines.registration
    target = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(model))
    source = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(observed))
    estimation = registration.TransformationEstimationPointToPoint()
    criteria = registration.ICPConvergenceCriteria(0.0, 0.0, iterations)
    return lambda: registration.registration_icp(source, target, REACH, np.eye(4), estimation, criteria)
