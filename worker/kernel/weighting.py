"""Weighted sums over correspondences, from which the normal equations follow (steps 4c and 4d).

Each visible vertex has residuals to its observed points, weighted by a robust kernel. A vertex in free space
also has a residual to the silhouette: no observed point is there that could report it. Surfaces seen at a
grazing angle have no such residual, as depth cameras do not measure them.

A vertex that is skinned to several links contributes to each of them in proportion to its weights: at the
position to which that link alone would move it, with the residual of the skinned vertex. So J^T r is exact at
the pose of the correspondences, and J^T J is an upper bound, which keeps steps from being too long.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.observation import PackedObservation
from worker.kernel.parameters import KernelParameters
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.visibility import NEAREST_M
from worker.kernel.workspace import Search, Workspace

Array = NDArray[np.float64]
Numbers = NDArray[np.uint32]

GRAZING = np.cos(np.radians(78.0))  # of the largest angle between normal and ray with valid depth


@numba.njit(cache=True, nogil=True, inline="always")
def robust_weight(squared: float, scale_squared: float) -> float:
    """Weight of a residual under the Geman-McClure kernel; 1 without a scale."""
    if scale_squared <= 0.0:
        return 1.0
    ratio = scale_squared / (scale_squared + squared)
    return ratio * ratio


@numba.njit(cache=True, nogil=True, inline="always")
def robust_cost(squared: float, scale_squared: float) -> float:
    """Cost of a residual under the Geman-McClure kernel; the square without a scale."""
    if scale_squared <= 0.0:
        return squared
    return scale_squared * squared / (scale_squared + squared)


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
    fill_targets(visible, observed, parameters, workspace.search, workspace.targets)
    if parameters.free_space:
        add_free_space(visible, skeleton, surface, observed, parameters, workspace)
    sum_by_link(visible, skeleton, surface, workspace)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fill_targets(
    visible: Numbers,
    observed: PackedObservation,
    parameters: KernelParameters,
    search: Search,
    targets: Array,
) -> None:
    """Fill targets (V, 4) with the weighted sum of each vertex's observed points, and the sum of weights."""
    shrink, scale_squared = 1.0 / parameters.stretch, parameters.outlier_squared
    points, closest, squared = observed.points, search.closest, search.squared
    targets[:] = 0.0
    for i in range(observed.count):
        weight, v = robust_weight(np.float64(squared[i]), scale_squared), visible[closest[i]]
        targets[v, 0] += weight * points[0, i]
        targets[v, 1] += weight * points[1, i]
        targets[v, 2] += weight * points[2, i] * shrink
        targets[v, 3] += weight


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_free_space(
    visible: Numbers,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> None:
    """Add the residuals of vertices in free space to workspace.targets.

    Their cost is the squared distance from the silhouette, in the metric of the noise.
    """
    free = vertices_in_free_space(visible, skeleton, surface, observed, workspace)
    posed, targets, offsets = workspace.posed, workspace.targets, workspace.offsets
    share = observed.count / len(visible)
    for n in range(len(free)):
        v, dx, dy = free[n], offsets[n, 0], offsets[n, 1]
        x, y, z = posed[v, 0], posed[v, 1], posed[v, 2]
        weight = share * robust_weight(dx * dx + dy * dy, parameters.outlier_squared)
        along = (dx * (x + dx) + dy * (y + dy)) / z
        targets[v, 0] += weight * (x + dx)
        targets[v, 1] += weight * (y + dy)
        targets[v, 2] += weight * (z - along / (parameters.stretch * parameters.stretch))
        targets[v, 3] += weight


@numba.njit(cache=True, nogil=True, error_model="numpy")
def vertices_in_free_space(
    visible: Numbers, skeleton: Skeleton, surface: Surface, observed: PackedObservation, workspace: Workspace
) -> Numbers:
    """The visible vertices in free space; fills a row of workspace.offsets (V, 2) for each of them.

    A row is the offset from the vertex to the nearest ray of the silhouette, in metres to the right and down
    at the vertex's depth. A vertex is not in free space if its pixel shows the subject or something that may
    hide it, if it is at most one pixel from the ray, if it is outside the image, or if the surface is seen at
    a grazing angle.
    """
    fx, fy, nearest = observed.fx, observed.fy, observed.nearest
    posed, offsets, free = workspace.posed, workspace.offsets, workspace.free
    transforms, normals, links = workspace.transforms, surface.normals, surface.skin_links
    count = 0
    for n in range(vertices_in_empty_pixels(visible, observed, workspace)):
        vertex, u, v = free[n], offsets[n, 0], offsets[n, 1]
        i, j, _ = pixel_at(u, v, observed)
        du, dv = nearest[1, i, j] - u, nearest[0, i, j] - v
        if abs(du) > 1.0 or abs(dv) > 1.0:
            x, y, z = posed[vertex, 0], posed[vertex, 1], posed[vertex, 2]
            link_dof = skeleton.link_dofs[links[vertex, 0]]
            if is_measurable(transforms, link_dof, normals, vertex, x, y, z):
                free[count], offsets[count, 0], offsets[count, 1] = vertex, du * z / fx, dv * z / fy
                count += 1
    return free[:count]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def vertices_in_empty_pixels(visible: Numbers, observed: PackedObservation, workspace: Workspace) -> int:
    """Fill workspace.free with the visible vertices in empty pixels; returns their number.

    Also fills workspace.offsets with their pixel coordinates. It has no branches, as they would be hard to
    predict.
    """
    empty, posed, offsets, free = observed.empty, workspace.posed, workspace.offsets, workspace.free
    left, top, right, bottom = observed.seen[0], observed.seen[1], observed.seen[2], observed.seen[3]
    count = 0
    for vertex in visible:
        z = posed[vertex, 2]
        per_z = 1.0 / max(z, NEAREST_M)
        u = observed.cx + observed.fx * posed[vertex, 0] * per_z
        v = observed.cy + observed.fy * posed[vertex, 1] * per_z
        i, j, inside = pixel_at(u, v, observed)
        seen = (left - 0.5 <= u) & (u < right - 0.5) & (top - 0.5 <= v) & (v < bottom - 0.5)
        free[count], offsets[count, 0], offsets[count, 1] = vertex, u, v
        count += seen & (z > NEAREST_M) & (empty[i, j] | (not inside))
    return count


@numba.njit(cache=True, nogil=True, inline="always")
def pixel_at(u: float, v: float, observed: PackedObservation) -> tuple[np.uint64, np.uint64, bool]:
    """Row and column of the pixel of observed.empty nearest to (u, v), and whether (u, v) lies in it."""
    height, width = observed.empty.shape
    row, column = int(np.floor(v + 0.5)), int(np.floor(u + 0.5))
    i, j = min(max(row, 0), height - 1), min(max(column, 0), width - 1)
    return np.uint64(i), np.uint64(j), (i == row) & (j == column)


@numba.njit(cache=True, nogil=True, inline="always")
def is_measurable(
    transforms: Array, t: int, normals: Array, vertex: int, x: float, y: float, z: float
) -> bool:
    """Whether the surface at a vertex at (x, y, z) is not seen at a grazing angle."""
    along = 0.0
    for a in range(3):
        turned = transforms[t, a, 0] * normals[vertex, 0] + transforms[t, a, 1] * normals[vertex, 1]
        turned += transforms[t, a, 2] * normals[vertex, 2]
        along += turned * (x if a == 0 else y if a == 1 else z)
    facing: bool = along * along > GRAZING * GRAZING * (x * x + y * y + z * z)
    return facing


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def sum_by_link(visible: Numbers, skeleton: Skeleton, surface: Surface, workspace: Workspace) -> None:
    """Sum M and C of each link (see `normal_equations`) over the visible vertices into equations.sums.

    The target is shifted with the vertex to the position to which the link alone moves it. So the residual
    stays that of the skinned vertex.
    """
    vertices, links, weights = surface.vertices, surface.skin_links, surface.skin_weights
    posed, targets, transforms = workspace.posed, workspace.targets, workspace.transforms
    link_dofs, sums = skeleton.link_dofs, workspace.equations.sums
    sums[:] = 0.0
    for v in visible:
        w = targets[v, 3]
        if w > 0.0:
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            for k in range(links.shape[1]):
                share, link = weights[v, k], links[v, k]
                if share > 0.0:
                    tx, ty, tz = targets[v, 0], targets[v, 1], targets[v, 2]
                    if share < 1.0:
                        t = link_dofs[link]
                        tx += w * (carry(transforms, t, 0, x, y, z) - posed[v, 0])
                        ty += w * (carry(transforms, t, 1, x, y, z) - posed[v, 1])
                        tz += w * (carry(transforms, t, 2, x, y, z) - posed[v, 2])
                    add_row(sums, link, 0, share * x, w, x, y, z, tx, ty, tz)
                    add_row(sums, link, 1, share * y, w, x, y, z, tx, ty, tz)
                    add_row(sums, link, 2, share * z, w, x, y, z, tx, ty, tz)
                    add_row(sums, link, 3, share, w, x, y, z, tx, ty, tz)


@numba.njit(cache=True, nogil=True, inline="always")
def carry(transforms: Array, t: int, axis: int, x: float, y: float, z: float) -> float:
    """One coordinate of a point after transform t of (D + 1, 3, 4)."""
    moved: float = (
        transforms[t, axis, 0] * x
        + transforms[t, axis, 1] * y
        + transforms[t, axis, 2] * z
        + transforms[t, axis, 3]
    )
    return moved


@numba.njit(cache=True, nogil=True, inline="always")
def add_row(  # noqa: PLR0913 compiled code takes numbers
    sums: Array,
    link: int,
    row: int,
    factor: float,
    w: float,
    x: float,
    y: float,
    z: float,
    tx: float,
    ty: float,
    tz: float,
) -> None:
    """Add factor * [w x, w y, w z, w, tx, ty, tz] to a row of a link of sums (L, 4, 7)."""
    sums[link, row, 0] += factor * w * x
    sums[link, row, 1] += factor * w * y
    sums[link, row, 2] += factor * w * z
    sums[link, row, 3] += factor * w
    sums[link, row, 4] += factor * tx
    sums[link, row, 5] += factor * ty
    sums[link, row, 6] += factor * tz
