"""The posed model and its visible points (steps 4a and 4b).

The depth image does not need a higher resolution than the vertices: its pixels are about PIXEL_M wide at the
distance of the body, independent of the camera.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Numbers
from gepf.common.bounds import MOST_PIXELS
from gepf.common.compiling import numba
from gepf.common.kinematics.chain import blend_vertex, forward_kinematics, shape_point, shape_points
from gepf.common.kinematics.manifold import apply_step
from gepf.worker.kernel.drawing import SIDE, draw_block
from gepf.worker.kernel.shape import shape_links
from gepf.worker.kernel.surface import Skeleton, Surface
from gepf.worker.kernel.workspace import LARGEST_SIDE_PX, Workspace

PIXEL_M = 0.012  # at the body's mean distance
TOLERANCE_M = 0.03  # largest distance of a visible point behind the depth image
NEAREST_M = 0.1  # smallest depth that is drawn


class DepthImage(NamedTuple):
    """The depth image of the posed surface; pixel (0, 0) is on the ray through (left, top, focal)."""

    depth: NDArray[np.float32]  # (H, W) metres, infinite without surface; the last rows and columns are empty
    triangles: Numbers  # (H, W) the visible triangle, if requested
    left: int
    top: int
    focal: float  # pixels


@numba.njit(cache=True, nogil=True)
def pose_body(pose: Array, skeleton: Skeleton, surface: Surface, workspace: Workspace) -> None:
    """Fill workspace.transforms, .of_rig and .posed with the body in pose (D,) (4a)."""
    transforms, posed = pose_links(pose, skeleton, workspace), workspace.posed
    for v in range(len(posed)):
        pose_vertex(v, pose, surface, transforms, posed)


@numba.njit(cache=True, nogil=True)
def pose_some(some: Numbers, pose: Array, skeleton: Skeleton, surface: Surface, workspace: Workspace) -> None:
    """As `pose_body`, but fill .posed for some vertices only."""
    transforms, posed = pose_links(pose, skeleton, workspace), workspace.posed
    for m in range(len(some)):
        pose_vertex(some[m], pose, surface, transforms, posed)


@numba.njit(cache=True, nogil=True, inline="always")
def pose_vertex(v: int, pose: Array, surface: Surface, transforms: Array, posed: Array) -> None:
    """Fill one row of posed (V, 3), with links' transforms (L, 3, 4)."""
    shape_point(v, surface.vertices, surface.shape_vertices, pose, posed)
    blend_vertex(v, posed, surface.skin_links, surface.skin_weights, transforms, posed)


@numba.njit(cache=True, nogil=True)
def pose_links(pose: Array, skeleton: Skeleton, workspace: Workspace) -> Array:
    """Fill workspace.transforms and .of_rig with the body in pose (D,).

    Returns the transforms of the links (L, 3, 4) into the camera's frame, at its time.
    """
    of_rig, transforms, then = workspace.of_rig, workspace.transforms, pose.copy()
    move_links(pose, skeleton, workspace)
    if np.any(workspace.step != 0.0):
        apply_step(skeleton.axes, skeleton.balls, workspace.step, then)
        forward_kinematics(
            skeleton.kinds, skeleton.parents, skeleton.axes, workspace.points, then, transforms
        )
        change_frame(workspace.T_camera_rig, transforms, transforms)
    else:
        change_frame(workspace.T_camera_rig, of_rig, transforms)
    return transforms[skeleton.link_dofs]  # -1, of links that nothing moves, is the last


@numba.njit(cache=True, nogil=True)
def move_links(pose: Array, skeleton: Skeleton, workspace: Workspace) -> None:
    """Fill workspace.points, .of_rig and .of_links with the body in pose (D,)."""
    of_rig, points = workspace.of_rig, workspace.points
    shape_points(skeleton.points, skeleton.shape_points, pose, points)
    forward_kinematics(skeleton.kinds, skeleton.parents, skeleton.axes, points, pose, of_rig)
    shape_links(pose, skeleton.link_dofs, skeleton.shape_fields, of_rig, workspace.of_links)


@numba.njit(cache=True, nogil=True)
def change_frame(T_camera_rig: Array, of_rig: Array, of_camera: Array) -> None:
    """Fill of_camera (N, 3, 4) with T_camera_rig (3, 4) times of_rig (N, 3, 4); both may be the same."""
    t = T_camera_rig
    for n in range(len(of_rig)):
        for b in range(4):
            x, y, z = of_rig[n, 0, b], of_rig[n, 1, b], of_rig[n, 2, b]
            for a in range(3):
                of_camera[n, a, b] = t[a, 0] * x + t[a, 1] * y + t[a, 2] * z + (t[a, 3] if b == 3 else 0.0)


@numba.njit(cache=True, nogil=True)
def visible_vertices(surface: Surface, workspace: Workspace) -> Numbers:
    """Indices, ascending, of the posed vertices that are visible from the origin (4b)."""
    posed, image, front, visible = workspace.posed, workspace.image, workspace.front, workspace.visible
    seen = draw(surface.triangles, False, workspace)
    height, width = seen.depth.shape
    count = 0
    for v in range(len(posed)):
        if front[v]:
            column, row = int(image[v, 0] - seen.left + 0.5), int(image[v, 1] - seen.top + 0.5)
            i, j = min(max(row, 0), height - 1), min(max(column, 0), width - 1)
            in_front = posed[v, 2] <= seen.depth[i, j] + TOLERANCE_M
            visible[count] = v
            count += in_front | (i != row) | (j != column)  # a branch would be hard to predict
    return visible[:count]


@numba.njit(cache=True, nogil=True)
def draw(triangles: Numbers, with_triangles: bool, workspace: Workspace) -> DepthImage:
    """The depth image of workspace.posed, and, if `with_triangles`, the triangles; fills workspace.front."""
    focal = float(np.mean(workspace.posed[:, 2])) / PIXEL_M
    left, top, right, bottom = project_all(workspace.posed, focal, workspace.image)
    width = max(1, min(LARGEST_SIDE_PX, right - left + 1)) + SIDE - 1  # edges far off overflow
    height = max(1, min(LARGEST_SIDE_PX, bottom - top + 1)) + SIDE - 1
    seen = DepthImage(
        workspace.depth[: height * width].reshape(height, width),
        workspace.seen_triangles[: height * width].reshape(height, width),
        left,
        top,
        focal,
    )
    rasterise(triangles, with_triangles, workspace, seen)
    return seen


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"nnan", "nsz"})
def project_all(posed: Array, focal: float, image: Array) -> tuple[int, int, int, int]:
    """Fill image (V, 2) with pixels of posed (V, 3); returns the left, top, right and bottom edge of all."""
    left = top = np.inf
    right = bottom = -np.inf
    for v in range(len(posed)):
        z = max(posed[v, 2], NEAREST_M)
        column, row = focal * posed[v, 0] / z, focal * posed[v, 1] / z
        image[v, 0], image[v, 1] = column, row
        left, right = min(left, column), max(right, column)
        top, bottom = min(top, row), max(bottom, row)
    return int(np.floor(left)), int(np.floor(top)), int(np.ceil(right)), int(np.ceil(bottom))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def rasterise(triangles: Numbers, with_triangles: bool, workspace: Workspace, seen: DepthImage) -> None:
    """Mark the vertices of triangles that face the camera in workspace.front, and draw these triangles.

    At most MOST_PIXELS are drawn, so that the work is bounded for any surface; a body needs far fewer. It is
    one function because a call for each triangle would count references.
    """
    posed, image, front, budget = workspace.posed, workspace.image, workspace.front, MOST_PIXELS
    depth, owners, left, top = seen.depth, seen.triangles, seen.left, seen.top
    front[:] = False
    depth[:] = np.inf
    before = np.empty((SIDE, SIDE), np.float32)
    for t in range(len(triangles)):
        a, b, c = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        bx, by = image[b, 0] - image[a, 0], image[b, 1] - image[a, 1]
        cx, cy = image[c, 0] - image[a, 0], image[c, 1] - image[a, 1]
        faces_camera = bx * cy < by * cx  # counter-clockwise from outside, y points down
        if not faces_camera or min(posed[a, 2], posed[b, 2], posed[c, 2]) <= NEAREST_M:
            continue
        front[a] = front[b] = front[c] = True
        ax, ay = image[a, 0] - left, image[a, 1] - top
        first_column = max(0, ceiling(ax + min(0.0, bx, cx)))
        first_row = max(0, ceiling(ay + min(0.0, by, cy)))
        last_column = min(depth.shape[1] - SIDE, int(ax + max(0.0, bx, cx)))
        last_row = min(depth.shape[0] - SIDE, int(ay + max(0.0, by, cy)))
        if first_column > last_column or first_row > last_row or budget <= 0:
            continue
        budget -= (last_row - first_row + 1) * (last_column - first_column + 1)
        scale = 1.0 / (bx * cy - by * cx)
        bx, by, cx, cy = bx * scale, by * scale, cx * scale, cy * scale
        z, zb, zc = posed[a, 2], posed[b, 2] - posed[a, 2], posed[c, 2] - posed[a, 2]
        for row in range(first_row, last_row + 1, SIDE):
            for column in range(first_column, last_column + 1, SIDE):
                if with_triangles:
                    before[:] = depth[row : row + SIDE, column : column + SIDE]
                x, y = column - ax, row - ay
                draw_block(depth, row, column, x, y, bx, by, cx, cy, z, zb, zc)  # type: ignore[call-arg]
                if with_triangles:
                    for n in range(SIDE * SIDE):
                        i, j = n // SIDE, n % SIDE
                        if depth[row + i, column + j] < before[i, j]:
                            owners[row + i, column + j] = t


@numba.njit(cache=True, nogil=True)
def ceiling(value: float) -> int:
    """The smallest integer not below a value; numpy returns a float, which is slower."""
    below = int(value)
    return below + (below < value)
