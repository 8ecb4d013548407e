"""The weighted sums over correspondences of which the normal equations are made (steps 4c and 4d).

Each visible vertex is drawn to its observed points, which a robust kernel weighs, and, where it lies in free
space, to the silhouette: closest points cannot report a model point where the camera saw nothing. Surfaces
that the camera looks along are left out there: depth cameras do not measure them.

A vertex that is blended over several links adds to each of them in proportion to its weights, from where that
link alone would carry it, with the residual of the blend. That leaves J^T r exact at the pose in which
correspondences were searched, and makes J^T J an upper bound, so steps stay safe.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.observation import PackedObservation
from worker.kernel.parameters import KernelParameters
from worker.kernel.rows import add_products
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.workspace import NormalEquations, SearchBuffers, Workspace

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Numbers = NDArray[np.uint32]

CLOSEST = 0.05  # metres from the camera's plane
GRAZING = np.cos(np.radians(78.0))  # between normal and line of sight: beyond it, nothing is measured


@numba.njit(cache=True, nogil=True, inline="always")
def robust_weight(squared: float, scale_squared: float) -> float:
    """Weight of a residual under Geman and McClure's kernel; 1 without a scale."""
    if scale_squared <= 0.0:
        return 1.0
    ratio = scale_squared / (scale_squared + squared)
    return ratio * ratio


@numba.njit(cache=True, nogil=True, inline="always")
def robust_cost(squared: float, scale_squared: float) -> float:
    """Cost of a residual under Geman and McClure's kernel; the square without a scale."""
    if scale_squared <= 0.0:
        return squared
    return scale_squared * squared / (scale_squared + squared)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def project_onto_silhouette(
    visible: Numbers,
    surface: Surface,
    link_dofs: Indices,
    transforms: Array,
    posed: Array,
    observed: PackedObservation,
    points: Array,
    squared: Array,
) -> None:
    """How far the visible ones of posed (V, 3) lie from the silhouette's nearest ray, at their own depth.

    Fills squared (V,) with the squared distances (m^2), in the order of `visible`, and points (V, 4) with
    what draws a vertex down their slope in the metric of the noise, and how surely its pixel is empty; 0
    where a vertex projects onto the subject or what may hide it, or outside what the camera saw, or where the
    surface is seen from the side.
    """
    nearest, emptiness, fx, fy, cx, cy = (
        observed.nearest,
        observed.emptiness,
        observed.fx,
        observed.fy,
        observed.cx,
        observed.cy,
    )
    left, top, right, bottom = observed.seen[0], observed.seen[1], observed.seen[2], observed.seen[3]
    height, width = emptiness.shape
    stretch_squared = observed.stretch * observed.stretch
    for m in range(len(visible)):
        x, y, z = posed[visible[m], 0], posed[visible[m], 1], posed[visible[m], 2]
        squared[m] = 0.0
        nearer = 1.0 / max(z, CLOSEST)
        u, v = cx + fx * x * nearer, cy + fy * y * nearer
        across, along = u + (0.5 - left), v + (0.5 - top)
        if 0.0 <= across < right - left and 0.0 <= along < bottom - top and z > CLOSEST:
            column, row = left + int(across), top + int(along)
            inside = 0 <= column < width and 0 <= row < height
            weight = emptiness[np.uint64(row), np.uint64(column)] if inside else np.float32(1.0)
            if weight == 0.0:
                continue
            i, j = np.uint64(min(max(row, 0), height - 1)), np.uint64(min(max(column, 0), width - 1))
            du, dv = nearest[1, i, j] - u, nearest[0, i, j] - v
            off = abs(du) > 1.0 or abs(dv) > 1.0
            if off and is_measurable(visible[m], surface, link_dofs, transforms, x, y, z):
                right_by, down_by = du * z / fx, dv * z / fy
                along_ray = right_by * (u + du - cx) / fx + down_by * (v + dv - cy) / fy
                points[m, 0], points[m, 1] = x + right_by, y + down_by
                points[m, 2] = z - along_ray / stretch_squared
                points[m, 3] = weight
                squared[m] = right_by * right_by + down_by * down_by


@numba.njit(cache=True, nogil=True)
def is_measurable(
    v: int, surface: Surface, link_dofs: Indices, transforms: Array, x: float, y: float, z: float
) -> bool:
    """Whether vertex v, which is at (x, y, z), is on a surface that the camera does not look along."""
    t = link_dofs[surface.skin_links[v, 0]]
    nx, ny, nz = surface.normals[v, 0], surface.normals[v, 1], surface.normals[v, 2]
    along = 0.0
    for a in range(3):
        turned = transforms[t, a, 0] * nx + transforms[t, a, 1] * ny + transforms[t, a, 2] * nz
        along += turned * (x if a == 0 else y if a == 1 else z)
    facing: bool = along * along > GRAZING * GRAZING * (x * x + y * y + z * z)
    return facing


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


@numba.njit(cache=True, nogil=True)
def add_correspondences(
    surface: Surface,
    skeleton: Skeleton,
    transforms: Array,
    visible: NDArray[np.uint32],
    posed: Array,
    weighted_targets: Array,
    equations: NormalEquations,
) -> None:
    """Sum moments and crosses of the visible ones of posed (V, 3) with their observed points.

    weighted_targets (V, 4) are those points' weighted sum and weight, in the order of `visible`. transforms
    (D + 1, 3, 4) are T_camera_rest, the last for links that nothing moves.
    """
    links, weights, sums, pulls = surface.skin_links, surface.skin_weights, equations.sums, weighted_targets
    sums[:] = 0.0
    for m in range(len(visible)):
        v = visible[m]
        w = pulls[m, 3]
        if w > 0.0:
            x, y, z, cx, cy, cz = posed[v, 0], posed[v, 1], posed[v, 2], pulls[m, 0], pulls[m, 1], pulls[m, 2]
            if not weights[v, 0] < 1.0:
                add_products(sums, links[v, 0], 1.0, x, y, z, cx, cy, cz, w)  # type: ignore[call-arg]
            else:
                add_blended(surface, skeleton.link_dofs, transforms, v, x, y, z, cx, cy, cz, w, sums)
    equations.moments[:] = sums[:, :, :4]
    equations.crosses[:] = sums[:, :, 4:7]


@numba.njit(cache=True, nogil=True)
def add_blended(  # noqa: PLR0913 compiled code takes numbers
    surface: Surface,
    link_dofs: NDArray[np.int64],
    transforms: Array,
    v: int,
    x: float,
    y: float,
    z: float,
    cx: float,
    cy: float,
    cz: float,
    w: float,
    sums: Array,
) -> None:
    """Add vertex v, which is at (x, y, z), as part of each of its links; (cx, cy, cz) and w are its pull.

    By numbers, not by rows: a row that is taken out of an array counts references.
    """
    px, py, pz = surface.vertices[v, 0], surface.vertices[v, 1], surface.vertices[v, 2]
    for k in range(surface.skin_links.shape[1]):
        share = surface.skin_weights[v, k]
        if not share > 0.0:
            break
        link = surface.skin_links[v, k]
        t = link_dofs[link]
        carried_x = carried(transforms, t, 0, px, py, pz)
        carried_y = carried(transforms, t, 1, px, py, pz)
        carried_z = carried(transforms, t, 2, px, py, pz)
        cx += w * (carried_x - x)  # the target moves along, so that the residual stays the blend's
        cy += w * (carried_y - y)
        cz += w * (carried_z - z)
        x, y, z = carried_x, carried_y, carried_z
        add_products(sums, link, share, x, y, z, cx, cy, cz, w)  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True)
def carried(transforms: Array, t: int, axis: int, x: float, y: float, z: float) -> float:
    """One coordinate of where transform t of (D + 1, 3, 4) takes a point."""
    moved: float = (
        transforms[t, axis, 0] * x
        + transforms[t, axis, 1] * y
        + transforms[t, axis, 2] * z
        + transforms[t, axis, 3]
    )
    return moved
