"""The model in a pose, and which of its points the camera sees (steps 4a and 4b).

The picture need not be finer than the surface's sampling: visibility asks for a depth buffer with pixels
of about PIXEL metres at the body's distance, whatever the real camera's resolution.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PIXEL = 0.012  # metres at the body's mean distance
TOLERANCE = 0.03  # metres that a visible point may lie behind the depth buffer
NEAR = 0.1  # metres; what is closer to the camera's plane is not drawn
LARGEST_SIDE = 512  # pixels


@numba.njit(cache=True, nogil=True)
def pose_surface(
    vertices: Array, skin_links: NDArray[np.int64], skin_weights: Array, t_links: Array, out: Array
) -> None:
    """Fill out (V, 3) with the vertices (V, 3) in the camera frame, blended over T_camera_rest (L, 3, 4)."""
    for v in range(len(vertices)):
        x, y, z = vertices[v]
        for a in range(3):
            total = 0.0
            for k in range(skin_links.shape[1]):
                weight = skin_weights[v, k]
                if weight > 0.0:
                    t = t_links[skin_links[v, k]]
                    total += weight * (t[a, 0] * x + t[a, 1] * y + t[a, 2] * z + t[a, 3])
            out[v, a] = total


@numba.njit(cache=True, nogil=True)
def visible_vertices(posed: Array, triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices, ascending, of the vertices (V, 3) that the camera at the origin sees."""
    image, front = project_front(posed, triangles)
    buffer, left, top = depth_buffer(image, posed[:, 2], triangles)
    count = 0
    visible = np.empty(len(posed), dtype=np.int64)
    for v in range(len(posed)):
        if front[v]:
            column, row = int(np.floor(image[v, 0] - left + 0.5)), int(np.floor(image[v, 1] - top + 0.5))
            inside = 0 <= row < buffer.shape[0] and 0 <= column < buffer.shape[1]
            if not inside or posed[v, 2] <= buffer[row, column] + TOLERANCE:
                visible[count] = v
                count += 1
    return visible[:count]


@numba.njit(cache=True, nogil=True)
def project_front(posed: Array, triangles: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
    """Image positions (V, 2) in buffer pixels, and which vertices belong to a triangle that faces us."""
    focal = np.mean(posed[:, 2]) / PIXEL
    image = np.empty((len(posed), 2))
    for v in range(len(posed)):
        z = max(posed[v, 2], NEAR)
        image[v, 0] = focal * posed[v, 0] / z
        image[v, 1] = focal * posed[v, 1] / z
    front = np.zeros(len(posed), dtype=np.bool_)
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        if faces_camera(image, a, b, c) and min(posed[a, 2], posed[b, 2], posed[c, 2]) > NEAR:
            front[a] = front[b] = front[c] = True
    return image, front


@numba.njit(cache=True, nogil=True, inline="always")
def faces_camera(image: Array, a: int, b: int, c: int) -> bool:
    """Whether a triangle, counter-clockwise from outside, shows its outside (y points down)."""
    shown: bool = (image[b, 0] - image[a, 0]) * (image[c, 1] - image[a, 1]) < (image[b, 1] - image[a, 1]) * (
        image[c, 0] - image[a, 0]
    )
    return shown


@numba.njit(cache=True, nogil=True)
def depth_buffer(
    image: Array, z: Array, triangles: NDArray[np.int64]
) -> tuple[NDArray[np.float32], int, int]:
    """Nearest depth of the front faces per pixel, infinite where nothing is; and its left and top edge."""
    left, top = int(np.floor(image[:, 0].min())), int(np.floor(image[:, 1].min()))
    width = min(LARGEST_SIDE, int(np.ceil(image[:, 0].max())) - left + 1)
    height = min(LARGEST_SIDE, int(np.ceil(image[:, 1].max())) - top + 1)
    buffer = np.full((height, width), np.float32(np.inf))
    for t in range(len(triangles)):
        a, b, c = triangles[t]
        if faces_camera(image, a, b, c) and min(z[a], z[b], z[c]) > NEAR:
            draw_triangle(image, z, a, b, c, left, top, buffer)
    return buffer, left, top


@numba.njit(cache=True, nogil=True, inline="always")
def draw_triangle(
    image: Array, z: Array, a: int, b: int, c: int, left: int, top: int, buffer: NDArray[np.float32]
) -> None:
    """Lower the buffer to the triangle's depth at every pixel centre that it covers."""
    ax, ay = image[a, 0] - left, image[a, 1] - top
    bx, by = image[b, 0] - left, image[b, 1] - top
    cx, cy = image[c, 0] - left, image[c, 1] - top
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area == 0.0:
        return
    first_column = max(0, int(np.ceil(min(ax, bx, cx))))
    last_column = min(buffer.shape[1] - 1, int(np.floor(max(ax, bx, cx))))
    first_row = max(0, int(np.ceil(min(ay, by, cy))))
    last_row = min(buffer.shape[0] - 1, int(np.floor(max(ay, by, cy))))
    for row in range(first_row, last_row + 1):
        for column in range(first_column, last_column + 1):
            wb = ((column - ax) * (cy - ay) - (row - ay) * (cx - ax)) / area
            wc = ((bx - ax) * (row - ay) - (by - ay) * (column - ax)) / area
            if wb >= -1e-9 and wc >= -1e-9 and wb + wc <= 1.0 + 1e-9:
                depth = z[a] + wb * (z[b] - z[a]) + wc * (z[c] - z[a])
                if depth < buffer[row, column]:
                    buffer[row, column] = depth
