"""The body in a pose: transforms along its tree (Eq. 1), axes of relative motion (Eq. 2), surface and joints.

Shape coefficients move the points of the rest pose. T_camera_rest after a degree of freedom maps rest-pose
coordinates to the camera frame. The surface is posed by linear blend skinning. Lengths are in metres, angles
in radians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Indices, Points
from gepf.common.body import SHAPE, TRANSLATION, BodyModel
from gepf.common.compiling import numba
from gepf.common.kinematics.rotations import fill_rotation


def contiguous(values: Array) -> Array:
    """A copy in C order, of float64: kernels are compiled for one memory layout."""
    return np.array(values, dtype=np.float64, order="C")


def dof_transforms(model: BodyModel, poses: Array) -> Array:
    """T_camera_rest (N, D, 3, 4) after each degree of freedom, for poses (N, D). Eq. 1."""
    out = np.empty((len(poses), len(model.kinds), 3, 4))
    points = shaped(model.points, model.shape_points, poses)
    forward_kinematics_each(model.kinds, model.parents, model.axes, points, contiguous(poses), out)
    return out


def link_transforms(model: BodyModel, poses: Array) -> Array:
    """T_camera_rest (N, L, 3, 4) of each link, for poses (N, D)."""
    out = np.empty((len(poses), len(model.kinds) + 1, 3, 4))
    out[:, -1] = np.eye(3, 4)  # of links that nothing moves
    points = shaped(model.points, model.shape_points, poses)
    forward_kinematics_each(model.kinds, model.parents, model.axes, points, contiguous(poses), out)
    return out.take(model.link_dofs, axis=1)


@numba.njit(cache=True, nogil=True)
def forward_kinematics(
    kinds: Indices, parents: Indices, axes: Array, points: Array, pose: Array, out: Array
) -> None:
    """Fill out (D, 3, 4) with T_camera_rest after each degree of freedom.

    `points` (D, 3) are those of the body with the shape of the pose.
    """
    local = np.zeros((3, 4))
    for j in range(len(kinds)):
        if kinds[j] == SHAPE:
            for a in range(3):
                for b in range(4):
                    local[a, b] = 1.0 if a == b else 0.0
        elif kinds[j] == TRANSLATION:
            for a in range(3):
                for b in range(3):
                    local[a, b] = 1.0 if a == b else 0.0
                local[a, 3] = axes[j, a] * pose[j]
        else:
            fill_rotation(axes[j, 0], axes[j, 1], axes[j, 2], pose[j], local)
            for a in range(3):  # the axis goes through the point
                local[a, 3] = points[j, a]
                for b in range(3):
                    local[a, 3] -= local[a, b] * points[j, b]
        compose(parents[j], local, j, out)


@numba.njit(cache=True, nogil=True)
def compose(parent: int, local: Array, j: int, out: Array) -> None:
    """out[j] = out[parent] o local, for (3, 4) transforms; out[j] = local if there is no parent."""
    for a in range(3):
        for b in range(4):
            if parent < 0:
                out[j, a, b] = local[a, b]
            else:
                total = out[parent, a, 3] if b == 3 else 0.0
                for c in range(3):
                    total += out[parent, a, c] * local[c, b]
                out[j, a, b] = total


@numba.njit(cache=True, nogil=True)
def forward_kinematics_each(
    kinds: Indices, parents: Indices, axes: Array, points: Array, poses: Array, out: Array
) -> None:
    """`forward_kinematics` for poses (N, D) into out (N, D, 3, 4); points (N, D, 3), or (1, D, 3) for all."""
    for n in range(len(poses)):
        forward_kinematics(kinds, parents, axes, points[n % len(points)], poses[n], out[n])


@numba.njit(cache=True, nogil=True)
def motion_axes(
    parents: Indices, axes: Array, points: Array, balls: Indices, transforms: Array, w: Array, q: Array
) -> None:
    """Fill w, q (D, 3) with axes of relative motion and points on them, camera frame. Eq. 2.

    A point p of a link that rotation j moves has the derivative w_j x (p - q_j); for a translation it is
    w_j. A spherical joint has the axes of its parent.
    """
    carrier = parents.copy()
    for start in balls:
        carrier[start + 1] = parents[start]
        carrier[start + 2] = parents[start]
    for j in range(len(parents)):
        for a in range(3):
            if carrier[j] < 0:
                w[j, a] = axes[j, a]
                q[j, a] = points[j, a]
            else:
                t = transforms[carrier[j]]
                w[j, a] = t[a, 0] * axes[j, 0] + t[a, 1] * axes[j, 1] + t[a, 2] * axes[j, 2]
                q[j, a] = t[a, 0] * points[j, 0] + t[a, 1] * points[j, 1] + t[a, 2] * points[j, 2] + t[a, 3]


def pose_vertices(model: BodyModel, poses: Array) -> Array:
    """Surface vertices (N, V, 3) in the camera frame, for poses (N, D)."""
    transforms = link_transforms(model, poses)
    vertices = shaped(model.vertices, model.shape_vertices, poses)
    return blend_each(vertices, model.skin_links, model.skin_weights, transforms)


def joint_positions(model: BodyModel, poses: Array) -> Array:
    """Named joints (N, J, 3) in the camera frame, for poses (N, D)."""
    t = link_transforms(model, poses).take(model.joint_links, axis=1)
    x, y, z = np.moveaxis(shaped(model.joint_points, model.shape_joint_points, poses), -1, 0)[..., None]
    return np.asarray(t[..., 0] * x + t[..., 1] * y + t[..., 2] * z + t[..., 3])


def shaped(rest: Array, directions: Array, poses: Array) -> Array:
    """Points of the rest pose (N, K, 3) with the shapes of poses (N, D), or (1, K, 3) if shape cannot change.

    `rest` (K, 3) are those of zero coefficients, directions (S, K, 3) their change per unit.
    """
    if not len(directions):
        return rest[None]
    out = np.empty((len(poses), *rest.shape))
    shape_points_each(rest, directions, contiguous(poses), out)
    return out


@numba.njit(cache=True, nogil=True)
def shape_points_each(rest: Array, directions: Array, poses: Array, out: Array) -> None:
    """`shape_points` for poses (N, D) into out (N, K, 3)."""
    for n in range(len(poses)):
        shape_points(rest, directions, poses[n], out[n])


@numba.njit(cache=True, nogil=True)
def shape_points(rest: Array, directions: Array | Points, pose: Array, out: Array) -> None:
    """Fill out (K, 3) with points (K, 3) of the rest pose in the shape of pose (D,); directions (S, K, 3)."""
    for k in range(len(rest)):
        shape_point(k, rest, directions, pose, out)


@numba.njit(cache=True, nogil=True, inline="always")
def shape_point(k: int, rest: Array, directions: Array | Points, pose: Array, out: Array) -> None:
    """Fill one row of `shape_points`."""
    x, y, z = rest[k, 0], rest[k, 1], rest[k, 2]
    for s in range(len(directions)):
        x += pose[s] * directions[s, k, 0]
        y += pose[s] * directions[s, k, 1]
        z += pose[s] * directions[s, k, 2]
    out[k, 0], out[k, 1], out[k, 2] = x, y, z


@numba.njit(cache=True, nogil=True)
def blend_vertices(
    vertices: Array, links: Indices | NDArray[np.uint32], weights: Array, transforms: Array, out: Array
) -> None:
    """Fill out (V, 3) with vertices (V, 3) blended over their links' T_camera_rest (L, 3, 4)."""
    for v in range(len(vertices)):
        blend_vertex(v, vertices, links, weights, transforms, out)


@numba.njit(cache=True, nogil=True, inline="always")
def blend_vertex(
    v: int,
    vertices: Array,
    links: Indices | NDArray[np.uint32],
    weights: Array,
    transforms: Array,
    out: Array,
) -> None:
    """Fill one row of `blend_vertices`; out may be the vertices."""
    x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
    moved_x = moved_y = moved_z = 0.0
    for k in range(links.shape[1]):
        share, s = weights[v, k], links[v, k]
        if share != 0.0:
            t = transforms
            moved_x += share * (t[s, 0, 0] * x + t[s, 0, 1] * y + t[s, 0, 2] * z + t[s, 0, 3])
            moved_y += share * (t[s, 1, 0] * x + t[s, 1, 1] * y + t[s, 1, 2] * z + t[s, 1, 3])
            moved_z += share * (t[s, 2, 0] * x + t[s, 2, 1] * y + t[s, 2, 2] * z + t[s, 2, 3])
    out[v, 0], out[v, 1], out[v, 2] = moved_x, moved_y, moved_z


@numba.njit(cache=True, nogil=True)
def blend_each(vertices: Array, links: Indices, weights: Array, transforms: Array) -> Array:
    """Vertices (N, V, 3) of `blend_vertices` for transforms (N, L, 3, 4); vertices (N or 1, V, 3)."""
    out = np.empty((len(transforms), vertices.shape[1], 3))
    for n in range(len(out)):
        blend_vertices(vertices[n % len(vertices)], links, weights, transforms[n], out[n])
    return out
