"""Free space: visible model points must not lie where the camera looks through to what is behind.

Such a point has a residual f_v, its distance from the nearest ray of the silhouette, because no observed
point is there. The cost is half the sum of rho(f_v), as if there were as many visible model points as
observed ones. Surfaces seen at a grazing angle have no such residual: depth cameras do not measure them.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Numbers, Points
from gepf.common.compiling import numba
from gepf.worker.kernel.observation import PackedObservation
from gepf.worker.kernel.terms.robust import robust_cost, robust_weight
from gepf.worker.kernel.vectors import add_scaled
from gepf.worker.kernel.visibility import NEAREST_M
from gepf.worker.kernel.workspace import CameraView, Workspace

GRAZING = np.cos(np.radians(78.0))  # of the largest angle between normal and ray with valid depth


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cost(view: CameraView) -> float:
    """Cost of the model points that a camera's free space contains."""
    weight, per_outlier = view.weights.free_space, view.problem.parameters.per_outlier_squared
    if weight == 0.0 or len(view.visible) == 0:
        return 0.0
    free, offsets, total = vertices_in_free_space(view), view.workspace.offsets, 0.0
    for n in range(len(free)):
        total += robust_cost(offsets[n, 0] ** 2 + offsets[n, 1] ** 2, per_outlier)
    return 0.5 * weight * view.observed.count / len(view.visible) * total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def linearise(view: CameraView) -> None:
    """Add the nearest place on the silhouette to the targets of each vertex in free space.

    The target is moved along the camera's axis so that the gradient in the metric of the noise is that of the
    distance from the ray.
    """
    weight, parameters, visible = view.weights.free_space, view.problem.parameters, view.visible
    if weight == 0.0 or len(visible) == 0:
        return
    posed, targets, offsets = view.workspace.posed, view.workspace.targets, view.workspace.offsets
    free, share = vertices_in_free_space(view), weight * view.observed.count / len(visible)
    for n in range(len(free)):
        m, dx, dy = free[n], offsets[n, 0], offsets[n, 1]
        x, y, z = posed[visible[m], 0], posed[visible[m], 1], posed[visible[m], 2]
        pull = share * robust_weight(dx * dx + dy * dy, parameters.per_outlier_squared)
        along = (dx * (x + dx) + dy * (y + dy)) / z
        z -= along / (parameters.stretch * parameters.stretch)
        add_scaled(targets, m, pull, (x + dx, y + dy, z, 1.0))  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def vertices_in_free_space(view: CameraView) -> Numbers:
    """Indices of the visible vertices in free space; fills a row of workspace.offsets (V, 2) for each.

    A row is the offset from the vertex to the nearest ray of the silhouette, in metres to the right and down
    at the vertex's depth. A vertex is not in free space if its pixel shows the subject or something that may
    hide it, if it is at most one pixel from the ray, if it is outside the image, or if the surface is seen at
    a grazing angle.
    """
    visible, observed, workspace = view.visible, view.observed, view.workspace
    fx, fy, nearest = observed.lens[0], observed.lens[1], observed.nearest
    height, width = observed.empty.shape
    posed, offsets, free = workspace.posed, workspace.offsets, workspace.free
    discs, stretch, count = workspace.search.discs, view.problem.parameters.stretch, 0
    for n in range(vertices_in_empty_pixels(visible, observed, workspace)):
        m, u, v = free[n], offsets[n, 0], offsets[n, 1]
        i = np.uint64(min(max(int(v + 0.5), 0), height - 1))
        j = np.uint64(min(max(int(u + 0.5), 0), width - 1))
        du, dv = nearest[1, i, j] - u, nearest[0, i, j] - v
        if abs(du) > 1.0 or abs(dv) > 1.0:
            vertex = visible[m]
            x, y, z = posed[vertex, 0], posed[vertex, 1], posed[vertex, 2]
            if is_measurable(discs[m], stretch, x, y, z):
                free[count], offsets[count, 0], offsets[count, 1] = m, du * z / fx, dv * z / fy
                count += 1
    return free[:count]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def vertices_in_empty_pixels(visible: Numbers, observed: PackedObservation, workspace: Workspace) -> int:
    """Fill workspace.free with the indices of the visible vertices in empty pixels; returns their number.

    Also fills workspace.offsets with their pixel coordinates. The test for an empty pixel is not a branch,
    because a branch would be hard to predict.
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
def is_measurable(disc: Points, stretch: float, x: float, y: float, z: float) -> bool:
    """Whether the surface at a vertex at (x, y, z), with this disc, is not seen at a grazing angle."""
    a, b, c = disc[0], disc[1], stretch * disc[2]
    along = a * x + b * y + c * z
    facing: bool = along * along > GRAZING * GRAZING * (a * a + b * b + c * c) * (x * x + y * y + z * z)
    return facing
