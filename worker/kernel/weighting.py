"""The weight of each correspondence in the normal equations: robust kernel and free space."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.free_space import project_onto_silhouette
from worker.kernel.packing import KernelParameters, PackedObservation
from worker.kernel.robust import robust_weight
from worker.kernel.search.correspondence import SearchBuffers
from worker.kernel.solver.sums import add_correspondences
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.workspace import Workspace

Array = NDArray[np.float64]
Numbers = NDArray[np.uint32]  # of vertices


@numba.njit(cache=True, nogil=True)
def accumulate_correspondences(
    visible: Numbers,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> None:
    """Sum all weighted correspondences into workspace.equations."""
    add_observed_points(len(visible), observed, parameters, workspace.search, workspace.weighted_targets)
    if parameters.free_space_weight > 0.0:
        add_free_space(visible, skeleton, surface, observed, parameters, workspace)
    add_correspondences(
        surface,
        skeleton,
        workspace.transforms,
        visible,
        workspace.visibility.posed,
        workspace.weighted_targets,
        workspace.equations,
    )


@numba.njit(cache=True, nogil=True)
def metric_of(parameters: KernelParameters) -> Array:
    """Weights (3,) of the camera's axes, depth's by its noise."""
    return np.array([1.0, 1.0, parameters.stretch * parameters.stretch])


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_observed_points(
    visible: int,
    observed: PackedObservation,
    parameters: KernelParameters,
    search: SearchBuffers,
    weighted_targets: Array,
) -> None:
    """Fill weighted_targets from the observed points."""
    shrink = 1.0 / parameters.stretch
    points, closest, weights = observed.points, search.closest, search.weights
    fill_robust_weights(search.squared, observed.count, parameters.outlier_squared, weights)
    weighted_targets[:visible] = 0.0
    for i in range(observed.count):
        weight, m = weights[i], closest[i]
        weighted_targets[m, 0] += weight * points[0, i]
        weighted_targets[m, 1] += weight * points[1, i]
        weighted_targets[m, 2] += weight * points[2, i] * shrink
        weighted_targets[m, 3] += weight


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_robust_weights(
    squared: NDArray[np.float32], count: int, scale_squared: float, weights: Array
) -> None:
    """Fill robust weights (count,) by squared distances."""
    for i in range(count):
        weights[i] = robust_weight(np.float64(squared[i]), scale_squared)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_free_space(
    visible: Numbers,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> None:
    """Add to workspace.weighted_targets what draws vertices in free space onto the silhouette."""
    targets, points, squared = (
        workspace.weighted_targets,
        workspace.silhouette_points,
        workspace.silhouette_squared,
    )
    find_silhouette_points(visible, skeleton, surface, observed, workspace)
    share = parameters.free_space_weight * observed.count / len(visible)
    for m in range(len(visible)):
        if squared[m] > 0.0:
            weight = share * points[m, 3] * robust_weight(squared[m], parameters.outlier_squared)
            for a in range(3):
                targets[m, a] += weight * points[m, a]
            targets[m, 3] += weight


@numba.njit(cache=True, nogil=True)
def find_silhouette_points(
    visible: Numbers, skeleton: Skeleton, surface: Surface, observed: PackedObservation, workspace: Workspace
) -> None:
    """Fill workspace.silhouette_points and .silhouette_squared for the visible vertices."""
    project_onto_silhouette(
        visible,
        surface,
        skeleton.link_dofs,
        workspace.transforms,
        workspace.visibility.posed,
        observed,
        workspace.silhouette_points,
        workspace.silhouette_squared,
    )
