"""The model in a pose, and which of its points the camera sees (steps 4a and 4b).

The picture need not be finer than the surface's sampling: visibility asks for a depth buffer with pixels
of about PIXEL metres at the body's distance, whatever the real camera's resolution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.bounds import MOST_PIXELS
from common.compiling import numba
from common.kinematics.chain import forward_kinematics
from worker.kernel.drawing import LANES, draw_row
from worker.kernel.rows import pose_lanes
from worker.kernel.surface import Skeleton, Surface
from worker.kernel.workspace import LARGEST_SIDE, ROW_PADDING, VisibilityBuffers

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Numbers = NDArray[np.uint32]  # of vertices and links, as the surface has them

PIXEL = 0.012  # metres at the body's mean distance
TOLERANCE = 0.03  # metres that a visible point may lie behind the depth buffer
NEAR = 0.1  # metres; what is closer to the camera's plane is not drawn


@numba.njit(cache=True, nogil=True)
def pose_surface(surface: Surface, transforms: Array, link_dofs: Indices, posed: Array) -> None:
    """Fill posed (V, 3) with the vertices in the camera frame, blended over their links' T_camera_rest."""
    vertices, links, weights = surface.vertices, surface.skin_links, surface.skin_weights
    columns = columns_of(transforms, link_dofs)
    for v in range(len(posed)):
        pose_lanes(columns, links, weights, vertices, v, posed)  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True)
def pose_vertices_of(
    some: Numbers, surface: Surface, transforms: Array, link_dofs: Indices, posed: Array
) -> None:
    """Pose some of the vertices, as `pose_surface` does all."""
    vertices, links, weights = surface.vertices, surface.skin_links, surface.skin_weights
    columns = columns_of(transforms, link_dofs)
    for v in some:
        pose_lanes(columns, links, weights, vertices, v, posed)  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True)
def columns_of(transforms: Array, link_dofs: Indices) -> Array:
    """The columns (L, 4, 4) of each link's transform, filled up with a zero, of transforms (D + 1, 3, 4)."""
    columns = np.zeros((len(link_dofs), 4, 4))
    for link in range(len(link_dofs)):
        t = link_dofs[link]  # -1, what nothing moves, is the last
        for a in range(3):
            for b in range(4):
                columns[link, b, a] = transforms[t, a, b]
    return columns


@numba.njit(cache=True, nogil=True)
def visible_vertices(view: VisibilityBuffers, triangles: Numbers) -> Numbers:
    """Indices, ascending, of the posed vertices that the camera at the origin sees. They stay in the view."""
    left, top, right, bottom = project_vertices(view.posed, view.image)
    width = max(1, min(LARGEST_SIDE, right - left + 1))  # of what lies too far off edges overflow
    height = max(1, min(LARGEST_SIDE, bottom - top + 1))
    buffer = view.buffer[: height * (width + ROW_PADDING)].reshape(height, width + ROW_PADDING)
    rasterise_front(view, triangles, left, top, buffer)
    posed, image, front, visible = view.posed, view.image, view.front, view.visible
    count = 0
    for v in range(len(posed)):
        if front[v]:
            column, row = int(np.floor(image[v, 0] - left + 0.5)), int(np.floor(image[v, 1] - top + 0.5))
            inside = 0 <= row < height and 0 <= column < width
            if not inside or posed[v, 2] <= buffer[row, column] + TOLERANCE:
                visible[count] = v
                count += 1
    return visible[:count]


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def rasterise_front(
    view: VisibilityBuffers, triangles: Numbers, left: int, top: int, buffer: NDArray[np.float32]
) -> None:
    """Mark the vertices of triangles that face us; nearest depth per pixel, infinite where nothing is.

    The last ROW_PADDING columns of the buffer stay infinite: a row is drawn LANES pixels at a time.
    What would be drawn after MOST_PIXELS, of which a body takes a small part, hides nothing: no surface can
    keep us drawing for ever. All in one function: what is called for each triangle counts references.
    """
    posed, image, front, budget = view.posed, view.image, view.front, MOST_PIXELS
    front[:] = False
    buffer[:] = np.inf
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        bx, by = image[b, 0] - image[a, 0], image[b, 1] - image[a, 1]
        cx, cy = image[c, 0] - image[a, 0], image[c, 1] - image[a, 1]
        shown = bx * cy < by * cx  # counter-clockwise from outside, y points down
        if not shown or min(posed[a, 2], posed[b, 2], posed[c, 2]) <= NEAR:
            continue
        front[a] = front[b] = front[c] = True
        ax, ay = image[a, 0] - left, image[a, 1] - top
        first_column = max(0, ceiling(ax + min(0.0, bx, cx)))
        first_row = max(0, ceiling(ay + min(0.0, by, cy)))
        last_column = min(buffer.shape[1] - 1 - ROW_PADDING, int(ax + max(0.0, bx, cx)))
        last_row = min(buffer.shape[0] - 1, int(ay + max(0.0, by, cy)))
        if first_column > last_column or first_row > last_row or budget <= 0:
            continue
        budget -= (last_row - first_row + 1) * (last_column - first_column + 1)
        scale = 1.0 / (bx * cy - by * cx)
        bx, by, cx, cy = bx * scale, by * scale, cx * scale, cy * scale
        z, zb, zc = posed[a, 2], posed[b, 2] - posed[a, 2], posed[c, 2] - posed[a, 2]
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1, LANES):
                x, y = column - ax, row - ay
                draw_row(buffer, row, column, x, y, bx, by, cx, cy, z, zb, zc)  # type: ignore[call-arg]


@numba.njit(cache=True, nogil=True)
def ceiling(value: float) -> int:
    """The least integer that is not below a value; numpy's ceil is another double, which takes longer."""
    below = int(value)
    return below + (below < value)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def project_vertices(posed: Array, image: Array) -> tuple[int, int, int, int]:
    """Fill image (V, 2) with positions in buffer pixels; gives left, top, right and bottom edge of all."""
    focal = np.mean(posed[:, 2]) / PIXEL
    left = top = np.inf
    right = bottom = -np.inf
    for v in range(len(posed)):
        z = max(posed[v, 2], NEAR)
        column, row = focal * posed[v, 0] / z, focal * posed[v, 1] / z
        image[v, 0], image[v, 1] = column, row
        left, right = min(left, column), max(right, column)
        top, bottom = min(top, row), max(bottom, row)
    return int(np.floor(left)), int(np.floor(top)), int(np.ceil(right)), int(np.ceil(bottom))


@numba.njit(cache=True, nogil=True)
def faces_camera(image: Array, a: int, b: int, c: int) -> bool:
    """Whether a triangle, counter-clockwise from outside, shows its outside (y points down)."""
    shown: bool = (image[b, 0] - image[a, 0]) * (image[c, 1] - image[a, 1]) < (image[b, 1] - image[a, 1]) * (
        image[c, 0] - image[a, 0]
    )
    return shown


@numba.njit(cache=True, nogil=True)
def update_visibility(
    pose: Array, skeleton: Skeleton, surface: Surface, transforms: Array, view: VisibilityBuffers
) -> Numbers:
    """Indices of the vertices that are visible in the pose (4a, 4b); fills transforms and view."""
    forward_kinematics(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, transforms)
    pose_surface(surface, transforms, skeleton.link_dofs, view.posed)
    return visible_vertices(view, surface.triangles)


@numba.njit(cache=True, nogil=True)
def repose_visible(
    pose: Array,
    visible: Numbers,
    skeleton: Skeleton,
    surface: Surface,
    transforms: Array,
    view: VisibilityBuffers,
) -> None:
    """Move the visible vertices to where they are in the pose, without a new depth buffer."""
    forward_kinematics(skeleton.kinds, skeleton.parents, skeleton.axes, skeleton.points, pose, transforms)
    pose_vertices_of(visible, surface, transforms, skeleton.link_dofs, view.posed)
