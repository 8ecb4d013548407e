"""Points of the body in the camera frame: the surface by linear blend skinning, and named joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.compiling import numba
from common.kinematics.chain import link_transforms

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def pose_vertices(model: BodyModel, poses: Array) -> Array:
    """Surface vertices (N, V, 3) in the camera frame, for poses (N, D)."""
    posed = np.empty((len(poses), *model.vertices.shape))
    blend_each(model.vertices, model.skin_links, model.skin_weights, link_transforms(model, poses), posed)
    return posed


def bounding_box(model: BodyModel, pose: Array) -> Array:
    """Lowest and highest x, y and z (2, 3) of the surface in the camera frame, for a pose (D,)."""
    t_links, box = link_transforms(model, pose[None])[0], np.empty((2, 3))
    enclose_vertices(model.vertices, model.skin_links, model.skin_weights, t_links, box)
    return box


def joint_positions(model: BodyModel, poses: Array) -> Array:
    """Named joints (N, J, 3) in the camera frame, for poses (N, D)."""
    positions = np.empty((len(poses), len(model.joint_links), 3))
    transform_points_each(model.joint_links, model.joint_points, link_transforms(model, poses), positions)
    return positions


@numba.njit(cache=True, nogil=True)
def blend(
    vertices: Array, links: Indices, weights: Array, transforms: Array, v: int
) -> tuple[float, float, float]:
    """Where vertex v of (V, 3) is, blended over its links' T_camera_rest (L, 3, 4)."""
    x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
    moved_x = moved_y = moved_z = 0.0
    for k in range(links.shape[1]):
        share, link = weights[v, k], links[v, k]
        if share != 0.0:
            t = transforms[link]
            moved_x += share * (t[0, 0] * x + t[0, 1] * y + t[0, 2] * z + t[0, 3])
            moved_y += share * (t[1, 0] * x + t[1, 1] * y + t[1, 2] * z + t[1, 3])
            moved_z += share * (t[2, 0] * x + t[2, 1] * y + t[2, 2] * z + t[2, 3])
    return moved_x, moved_y, moved_z


@numba.njit(cache=True, nogil=True)
def blend_each(vertices: Array, links: Indices, weights: Array, transforms: Array, out: Array) -> None:
    """Fill out (N, V, 3) with vertices (V, 3) blended over their links' T_camera_rest (N, L, 3, 4)."""
    for n in range(len(out)):
        for v in range(len(vertices)):
            out[n, v, 0], out[n, v, 1], out[n, v, 2] = blend(vertices, links, weights, transforms[n], v)


@numba.njit(cache=True, nogil=True)
def enclose_vertices(vertices: Array, links: Indices, weights: Array, transforms: Array, box: Array) -> None:
    """Fill box (2, 3) with the lowest and highest coordinates of vertices (V, 3) after `blend`."""
    x_low = y_low = z_low = np.inf
    x_high = y_high = z_high = -np.inf
    for v in range(len(vertices)):
        x, y, z = blend(vertices, links, weights, transforms, v)
        x_low, y_low, z_low = min(x_low, x), min(y_low, y), min(z_low, z)
        x_high, y_high, z_high = max(x_high, x), max(y_high, y), max(z_high, z)
    box[0, 0], box[0, 1], box[0, 2] = x_low, y_low, z_low
    box[1, 0], box[1, 1], box[1, 2] = x_high, y_high, z_high


@numba.njit(cache=True, nogil=True)
def transform_points_each(links: Indices, points: Array, transforms: Array, out: Array) -> None:
    """Fill out (N, J, 3) with points (J, 3), each moved by its link's transform of (N, L, 3, 4)."""
    for n in range(len(out)):
        for j in range(len(links)):
            for a in range(3):
                t = transforms[n, links[j], a]
                out[n, j, a] = t[0] * points[j, 0] + t[1] * points[j, 1] + t[2] * points[j, 2] + t[3]
