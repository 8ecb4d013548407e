"""Weighted sums over correspondences, from which the normal equations follow (steps 4c and 4d).

Each visible vertex has residuals to its observed points, weighted by a robust kernel. A vertex in free space
also has a residual to the silhouette, because no observed point is there. Surfaces seen at a grazing angle
have no such residual, because depth cameras do not measure them.

A vertex that is skinned to several links contributes to each of them in proportion to its weights: at the
position to which that link alone would move it, with the residual of the skinned vertex. So J^T r is exact at
the pose of the correspondences, and J^T J is an upper bound, which keeps steps from being too long.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array, Numbers
from gepf.common.compiling import numba
from gepf.worker.kernel.observation import PackedObservation
from gepf.worker.kernel.parameters import KernelParameters
from gepf.worker.kernel.surface import Skeleton, Surface
from gepf.worker.kernel.vectors import add_scaled
from gepf.worker.kernel.visibility import NEAREST_M
from gepf.worker.kernel.workspace import Workspace

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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def accumulate_correspondences(
    visible: Numbers,
    skeleton: Skeleton,
    surface: Surface,
    observed: PackedObservation,
    parameters: KernelParameters,
    workspace: Workspace,
) -> None:
    """Sum all weighted correspondences of a camera into workspace.sums.

    Each visible vertex has a row of workspace.targets: the weighted sum of its targets, and the sum of their
    weights. Targets are the observed points and, of a vertex in free space, the nearest place on the
    silhouette. The cost of the latter is the squared distance, in the metric of the noise.
    """
    shrink, scale_squared = 1.0 / parameters.stretch, parameters.outlier_squared
    points, closest, squared = observed.points, workspace.search.closest, workspace.search.squared
    posed, targets, offsets = workspace.posed, workspace.targets, workspace.offsets
    targets[: len(visible)] = 0.0
    for i in range(observed.count):
        weight = robust_weight(np.float64(squared[i]), scale_squared)
        x, y, z = np.float64(points[0, i]), np.float64(points[1, i]), points[2, i] * shrink
        add_scaled(targets, closest[i], weight, (x, y, z, 1.0))  # type: ignore[call-arg]
    if parameters.free_space:
        free = vertices_in_free_space(visible, skeleton, surface, observed, workspace)
        share = observed.count / len(visible)
        for n in range(len(free)):
            m, dx, dy = free[n], offsets[n, 0], offsets[n, 1]
            x, y, z = posed[visible[m], 0], posed[visible[m], 1], posed[visible[m], 2]
            weight = share * robust_weight(dx * dx + dy * dy, scale_squared)
            along = (dx * (x + dx) + dy * (y + dy)) / z
            z -= along / (parameters.stretch * parameters.stretch)
            add_scaled(targets, m, weight, (x + dx, y + dy, z, 1.0))  # type: ignore[call-arg]
    sum_by_link(visible, skeleton, surface, workspace)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def vertices_in_free_space(
    visible: Numbers, skeleton: Skeleton, surface: Surface, observed: PackedObservation, workspace: Workspace
) -> Numbers:
    """Indices of the visible vertices in free space; fills a row of workspace.offsets (V, 2) for each.

    A row is the offset from the vertex to the nearest ray of the silhouette, in metres to the right and down
    at the vertex's depth. A vertex is not in free space if its pixel shows the subject or something that may
    hide it, if it is at most one pixel from the ray, if it is outside the image, or if the surface is seen at
    a grazing angle.
    """
    fx, fy, nearest = observed.lens[0], observed.lens[1], observed.nearest
    height, width = observed.empty.shape
    posed, offsets, free = workspace.posed, workspace.offsets, workspace.free
    transforms, normals, links = workspace.transforms, surface.normals, surface.skin_links
    count = 0
    for n in range(vertices_in_empty_pixels(visible, observed, workspace)):
        m, u, v = free[n], offsets[n, 0], offsets[n, 1]
        i = np.uint64(min(max(int(v + 0.5), 0), height - 1))
        j = np.uint64(min(max(int(u + 0.5), 0), width - 1))
        du, dv = nearest[1, i, j] - u, nearest[0, i, j] - v
        if abs(du) > 1.0 or abs(dv) > 1.0:
            vertex = visible[m]
            x, y, z = posed[vertex, 0], posed[vertex, 1], posed[vertex, 2]
            link_dof = skeleton.link_dofs[links[vertex, 0]]
            if is_measurable(transforms, link_dof, normals, vertex, x, y, z):
                free[count], offsets[count, 0], offsets[count, 1] = m, du * z / fx, dv * z / fy
                count += 1
    return free[:count]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def vertices_in_empty_pixels(visible: Numbers, observed: PackedObservation, workspace: Workspace) -> int:
    """Fill workspace.free with the indices of the visible vertices in empty pixels; returns their number.

    Also fills workspace.offsets with their pixel coordinates. Whether a pixel is empty is no branch, as it
    would be hard to predict.
    """
    empty, posed, offsets, free = observed.empty, workspace.posed, workspace.offsets, workspace.free
    fx, fy, cx, cy = observed.lens[0], observed.lens[1], observed.lens[2], observed.lens[3]
    left, top, right, bottom = observed.seen[0], observed.seen[1], observed.seen[2], observed.seen[3]
    count = 0
    for m in range(len(visible)):
        vertex = visible[m]
        z = posed[vertex, 2]
        if z > NEAREST_M:
            per_z = 1.0 / z
            u = cx + fx * posed[vertex, 0] * per_z
            v = cy + fy * posed[vertex, 1] * per_z
            free[count], offsets[count, 0], offsets[count, 1] = m, u, v
            column, row = u + 0.5, v + 0.5
            if 0.0 <= column < empty.shape[1] and 0.0 <= row < empty.shape[0]:
                count += empty[np.uint64(row), np.uint64(column)]
            elif left <= column < right and top <= row < bottom:
                count += 1
    return count


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


@numba.njit(cache=True, nogil=True)
def sum_by_link(visible: Numbers, skeleton: Skeleton, surface: Surface, workspace: Workspace) -> None:
    """Sum M and C of each link (see `normal_equations`) over the visible vertices into workspace.sums.

    The target is shifted with the vertex to the position to which the link alone moves it. So the residual
    stays that of the skinned vertex: with T the link's transform in the rig now, and e the weighted residual
    in the rig's frame, C_s = sum X e^T + M_s T^T.
    """
    vertices, links, weights = surface.vertices, surface.skin_links, surface.skin_weights
    posed, targets, sums = workspace.posed, workspace.targets, workspace.sums
    sums[:] = 0.0
    for m in range(len(visible)):
        w, v = targets[m, 3], visible[m]
        if w > 0.0:
            x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
            ex, ey, ez = (
                targets[m, 0] - w * posed[v, 0],
                targets[m, 1] - w * posed[v, 1],
                targets[m, 2] - w * posed[v, 2],
            )
            row = w * x, w * y, w * z, w, ex, ey, ez, 0.0
            for k in range(links.shape[1]):
                share, first = weights[v, k], 4 * links[v, k]
                if share > 0.0:
                    add_scaled(sums, first, share * x, row)  # type: ignore[call-arg]
                    add_scaled(sums, first + 1, share * y, row)
                    add_scaled(sums, first + 2, share * z, row)
                    add_scaled(sums, first + 3, share, row)
    turn = workspace.T_camera_rig
    for link in range(len(sums)):
        t = workspace.of_rig[skeleton.link_dofs[link]]
        for a in range(4):
            ex, ey, ez = sums[link, a, 4], sums[link, a, 5], sums[link, a, 6]
            for b in range(3):
                total = turn[0, b] * ex + turn[1, b] * ey + turn[2, b] * ez
                for c in range(4):
                    total += sums[link, a, c] * t[b, c]
                sums[link, a, 4 + b] = total
