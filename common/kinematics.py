"""Forward kinematics (Eq. 1) and the axes of relative motion (Eq. 2), batched over particles.

`dof_transforms` gives T_camera_rest after each degree of freedom: it maps rest-pose coordinates to the
camera. A pose is a vector of joint values; a *step* is a vector of relative motion about axes in the
camera frame. For single axes the two add. For a ball (three rotations about orthonormal axes through one
point, so also the root) the step is one rotation vector along the ball's axes as its parent carries them,
which has no singular pose; the joint values that belong to it are found on the branch nearest to the old.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from common.body import TRANSLATION, BodyModel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def dof_transforms(model: BodyModel, poses: Array) -> Array:
    """T_camera_rest (N, D, 3, 4) after each degree of freedom, for poses (N, D). Eq. 1."""
    out = np.empty((len(poses), len(model.kinds), 3, 4))
    chain_each(model.kinds, model.parents, model.axes, model.points, copied(poses), out)
    return out


def link_transforms(model: BodyModel, poses: Array) -> Array:
    """T_camera_rest (N, L, 3, 4) of each link, for poses (N, D)."""
    out = np.empty((len(poses), len(model.link_dofs), 3, 4))
    hand_to_links(dof_transforms(model, poses), model.link_dofs, out)
    return out


def pose_vertices(model: BodyModel, poses: Array) -> Array:
    """Surface vertices (N, V, 3) in the camera frame, for poses (N, D)."""
    posed = np.empty((len(poses), *model.vertices.shape))
    blend_each(model.vertices, model.skin_links, model.skin_weights, link_transforms(model, poses), posed)
    return posed


def bounding_box(model: BodyModel, pose: Array) -> Array:
    """Lowest and highest x, y and z (2, 3) of the surface in the camera frame, for a pose (D,)."""
    t_links, box = link_transforms(model, pose[None])[0], np.empty((2, 3))
    enclose(model.vertices, model.skin_links, model.skin_weights, t_links, box)
    return box


def joint_positions(model: BodyModel, poses: Array) -> Array:
    """Named joints (N, J, 3) in the camera frame, for poses (N, D)."""
    positions = np.empty((len(poses), len(model.joint_links), 3))
    carry_points_each(model.joint_links, model.joint_points, link_transforms(model, poses), positions)
    return positions


def step_axes(model: BodyModel, poses: Array) -> tuple[Array, Array]:
    """Axes w (N, D, 3) and points q (N, D, 3) of relative motion in the camera frame. Eq. 2.

    A point p of a link that rotation j moves has derivative w_j x (p - q_j); translation, w_j.
    """
    w = np.empty((len(poses), len(model.kinds), 3))
    q = np.empty_like(w)
    carry_axes_each(model.parents, model.axes, model.points, model.balls, dof_transforms(model, poses), w, q)
    return w, q


def retract(model: BodyModel, poses: Array, steps: Array) -> Array:
    """Poses (N, D) after relative motion by steps (N, D). Inverse of `difference`."""
    moved = copied(poses)
    apply_step_each(model.axes, model.balls, copied(steps), moved)
    return moved


def difference(model: BodyModel, origins: Array, poses: Array) -> Array:
    """Steps (N, D) that lead from `origins` to `poses`, both (N, D); rotations by the shorter way."""
    steps = copied(poses - origins)
    turn_each(model.axes, model.balls, copied(origins), copied(poses), steps)
    return steps


def natural_angles(model: BodyModel, poses: Array) -> Array:
    """The same poses (N, D), each ball's angles on the branch that leaves its limits less.

    Rx(a) Ry(b) Rz(c) is also Rx(a + pi) Ry(pi - b) Rz(c + pi). Where no limit tells them apart, angles stay.
    """
    natural = copied(poses)
    choose_branch_each(model.balls, model.limits, natural)
    return natural


def copied(values: Array) -> Array:
    """Values of their own, row by row: kernels are compiled for one layout."""
    return np.array(values, dtype=np.float64, order="C")


@numba.njit(cache=True, nogil=True)
def turn(x: float, y: float, z: float, angle: float, out: Array) -> None:
    """Fill the first three columns of out with the rotation about a unit axis (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    k = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k


@numba.njit(cache=True, nogil=True)
def chain(kinds: Indices, parents: Indices, axes: Array, points: Array, pose: Array, out: Array) -> None:
    """Fill out (D, 3, 4) with T_camera_rest after each degree of freedom."""
    local = np.zeros((3, 4))
    for j in range(len(kinds)):
        if kinds[j] == TRANSLATION:
            for a in range(3):
                for b in range(3):
                    local[a, b] = 1.0 if a == b else 0.0
                local[a, 3] = axes[j, a] * pose[j]
        else:
            turn(axes[j, 0], axes[j, 1], axes[j, 2], pose[j], local)
            for a in range(3):
                local[a, 3] = points[j, a]
                for b in range(3):
                    local[a, 3] -= local[a, b] * points[j, b]
        append(parents[j], local, j, out)


@numba.njit(cache=True, nogil=True)
def append(parent: int, local: Array, j: int, out: Array) -> None:
    """out[j] = out[parent] o local, for (3, 4) transforms; = local, where there is no parent."""
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
def chain_each(
    kinds: Indices, parents: Indices, axes: Array, points: Array, poses: Array, out: Array
) -> None:
    """`chain` for poses (N, D) into out (N, D, 3, 4)."""
    for n in range(len(poses)):
        chain(kinds, parents, axes, points, poses[n], out[n])


@numba.njit(cache=True, nogil=True)
def hand_to_links(transforms: Array, link_dofs: Indices, out: Array) -> None:
    """Fill out (N, L, 3, 4) with transforms (N, D, 3, 4), each its link's; none for what nothing moves."""
    for n in range(len(out)):
        for link in range(len(link_dofs)):
            for a in range(3):
                for b in range(4):
                    if link_dofs[link] < 0:
                        out[n, link, a, b] = 1.0 if a == b else 0.0
                    else:
                        out[n, link, a, b] = transforms[n, link_dofs[link], a, b]


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
def enclose(vertices: Array, links: Indices, weights: Array, transforms: Array, box: Array) -> None:
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
def carry_points_each(links: Indices, points: Array, transforms: Array, out: Array) -> None:
    """Fill out (N, J, 3) with points (J, 3), each moved by its link's transform of (N, L, 3, 4)."""
    for n in range(len(out)):
        for j in range(len(links)):
            for a in range(3):
                t = transforms[n, links[j], a]
                out[n, j, a] = t[0] * points[j, 0] + t[1] * points[j, 1] + t[2] * points[j, 2] + t[3]


@numba.njit(cache=True, nogil=True)
def choose_branch_each(balls: Indices, limits: Array, poses: Array) -> None:
    """`natural_angles` of poses (N, D) in place."""
    near, best = np.empty(3), np.empty(3)
    for n in range(len(poses)):
        for start in balls:
            angles, low, high = poses[n, start : start + 3], limits[start:, 0], limits[start:, 1]
            best[:] = angles
            for flip in range(2):
                for a in range(3):
                    turned = angles[a] if flip == 0 else np.pi + (-angles[a] if a == 1 else angles[a])
                    near[a] = (turned + np.pi) % (2.0 * np.pi) - np.pi
                if excess(near, low, high) < excess(best, low, high) - 1e-9:
                    best[:] = near
            angles[:] = best


@numba.njit(cache=True, nogil=True)
def excess(angles: Array, low: Array, high: Array) -> float:
    """Sum of how far angles (3,) lie outside of their limits."""
    total = 0.0
    for a in range(3):
        total += abs(angles[a] - min(max(angles[a], low[a]), high[a]))
    return total


@numba.njit(cache=True, nogil=True)
def carry_axes(
    parents: Indices, axes: Array, points: Array, balls: Indices, transforms: Array, w: Array, q: Array
) -> None:
    """Fill w, q (D, 3) with the camera-frame axes of relative motion; a ball's are its parent's."""
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


@numba.njit(cache=True, nogil=True)
def carry_axes_each(
    parents: Indices, axes: Array, points: Array, balls: Indices, transforms: Array, w: Array, q: Array
) -> None:
    """`carry_axes` for transforms (N, D, 3, 4) into w, q (N, D, 3)."""
    for n in range(len(transforms)):
        carry_axes(parents, axes, points, balls, transforms[n], w[n], q[n])


@numba.njit(cache=True, nogil=True)
def euler_matrix(angles: Array) -> Array:
    """Rx(a) Ry(b) Rz(c) as (3, 3)."""
    ca, sa = np.cos(angles[0]), np.sin(angles[0])
    cb, sb = np.cos(angles[1]), np.sin(angles[1])
    cc, sc = np.cos(angles[2]), np.sin(angles[2])
    out = np.empty((3, 3))
    out[0, 0], out[0, 1], out[0, 2] = cb * cc, -cb * sc, sb
    out[1, 0], out[1, 1], out[1, 2] = ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb
    out[2, 0], out[2, 1], out[2, 2] = sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb
    return out


@numba.njit(cache=True, nogil=True)
def nearest_turn(angle: float, reference: float) -> float:
    """`angle` plus the multiple of a full turn that brings it nearest to `reference`."""
    turns: float = np.round((reference - angle) / (2.0 * np.pi))
    return angle + 2.0 * np.pi * turns


@numba.njit(cache=True, nogil=True)
def euler_angles(rotation: Array, reference: Array) -> Array:
    """Angles (3,) of Rx Ry Rz nearest to `reference` (3,) among the two branches and full turns."""
    sb = min(1.0, max(-1.0, rotation[0, 2]))
    best = np.empty(3)
    if abs(sb) > 1.0 - 1e-12:  # Rx and Rz turn about the same line: keep the third angle
        best[2] = reference[2]
        best[1] = nearest_turn(np.arcsin(sb), reference[1])
        both = np.arctan2(rotation[2, 1], rotation[1, 1])
        best[0] = nearest_turn(both - np.sign(sb) * best[2], reference[0])
        return best
    a = np.arctan2(-rotation[1, 2], rotation[2, 2])
    c = np.arctan2(-rotation[0, 1], rotation[0, 0])
    b = np.arcsin(sb)
    nearest = np.inf
    for branch in range(2):
        x = nearest_turn(a + branch * np.pi, reference[0])
        y = nearest_turn(b if branch == 0 else np.pi - b, reference[1])
        z = nearest_turn(c + branch * np.pi, reference[2])
        distance = (x - reference[0]) ** 2 + (y - reference[1]) ** 2 + (z - reference[2]) ** 2
        if distance < nearest:
            nearest = distance
            best[0], best[1], best[2] = x, y, z
    return best


@numba.njit(cache=True, nogil=True)
def rotation_vector(rotation: Array) -> Array:
    """Rotation vector (3,) of a rotation matrix, by way of the unit quaternion."""
    trace = rotation[0, 0] + rotation[1, 1] + rotation[2, 2]
    quaternion = np.empty(4)  # x, y, z, w
    quaternion[0], quaternion[1], quaternion[2] = rotation[0, 0], rotation[1, 1], rotation[2, 2]
    quaternion[3] = trace
    k = np.argmax(quaternion)
    if k == 3:
        quaternion[3] = 1.0 + trace
        quaternion[0] = rotation[2, 1] - rotation[1, 2]
        quaternion[1] = rotation[0, 2] - rotation[2, 0]
        quaternion[2] = rotation[1, 0] - rotation[0, 1]
    else:
        i, j = (k + 1) % 3, (k + 2) % 3
        quaternion[k] = 1.0 + 2.0 * rotation[k, k] - trace
        quaternion[i] = rotation[i, k] + rotation[k, i]
        quaternion[j] = rotation[j, k] + rotation[k, j]
        quaternion[3] = rotation[j, i] - rotation[i, j]
    sine_squared = quaternion[0] ** 2 + quaternion[1] ** 2 + quaternion[2] ** 2
    length = np.sqrt(sine_squared + quaternion[3] ** 2)
    if quaternion[3] < 0.0:
        length = -length
    sine = np.sqrt(sine_squared) / abs(length)
    scale = 2.0 / length if sine < 1e-12 else 2.0 * np.arctan2(sine, quaternion[3] / length) / sine / length
    vector: Array = scale * quaternion[:3]
    return vector


@numba.njit(cache=True, nogil=True)
def handedness(axes: Array) -> float:
    """1 for right-handed orthonormal axes (3, 3); -1 for left-handed ones, where angles turn back."""
    volume = (
        (axes[0, 1] * axes[1, 2] - axes[0, 2] * axes[1, 1]) * axes[2, 0]
        + (axes[0, 2] * axes[1, 0] - axes[0, 0] * axes[1, 2]) * axes[2, 1]
        + (axes[0, 0] * axes[1, 1] - axes[0, 1] * axes[1, 0]) * axes[2, 2]
    )
    return 1.0 if volume > 0.0 else -1.0


@numba.njit(cache=True, nogil=True)
def product(one: Array, other: Array) -> Array:
    """one @ other, (3, 3): so small that a library's call costs more than the product."""
    out = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            out[a, b] = one[a, 0] * other[0, b] + one[a, 1] * other[1, b] + one[a, 2] * other[2, b]
    return out


@numba.njit(cache=True, nogil=True)
def apply_step(axes: Array, balls: Indices, step: Array, pose: Array) -> None:
    """Move pose (D,) in place by step (D,): add it, and turn each ball by its rotation vector."""
    old, turned = pose.copy(), np.empty((3, 3))
    pose += step
    for start in balls:
        a = axes[start : start + 3]
        handed = handedness(a)
        x, y, z = step[start], step[start + 1], step[start + 2]
        angle = np.sqrt(x * x + y * y + z * z)
        angles = handed * old[start : start + 3]
        if angle > 1e-15:
            turn(x / angle, y / angle, z / angle, handed * angle, turned)
            angles = euler_angles(product(turned, euler_matrix(angles)), angles)
        pose[start : start + 3] = handed * angles


@numba.njit(cache=True, nogil=True)
def apply_step_each(axes: Array, balls: Indices, steps: Array, poses: Array) -> None:
    """`apply_step` for steps (N, D), poses (N, D) in place."""
    for n in range(len(poses)):
        apply_step(axes, balls, steps[n], poses[n])


@numba.njit(cache=True, nogil=True)
def turn_each(axes: Array, balls: Indices, origins: Array, poses: Array, steps: Array) -> None:
    """Fill in the rotation vectors of all balls in steps (N, D) from origins (N, D) to poses (N, D)."""
    for start in balls:
        handed = handedness(axes[start : start + 3])
        for n in range(len(steps)):
            ball_turn(handed, origins[n, start : start + 3], poses[n, start : start + 3], steps[n, start:])


@numba.njit(cache=True, nogil=True)
def ball_turn(handed: float, before: Array, after: Array, out: Array) -> None:
    """Fill the first three of out with the rotation vector that leads from angles (3,) to others."""
    bw, bx, by, bz = quaternion(handed * before[0], handed * before[1], handed * before[2])
    aw, ax, ay, az = quaternion(handed * after[0], handed * after[1], handed * after[2])
    w = aw * bw + ax * bx + ay * by + az * bz  # after * conjugate of before
    x = ax * bw - aw * bx + az * by - ay * bz
    y = ay * bw - aw * by + ax * bz - az * bx
    z = az * bw - aw * bz + ay * bx - ax * by
    sine = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 * handed if sine < 1e-12 else 2.0 * handed * np.arctan2(sine, abs(w)) / sine
    if w < 0.0:
        scale = -scale
    out[0], out[1], out[2] = scale * x, scale * y, scale * z


@numba.njit(cache=True, nogil=True)
def quaternion(a: float, b: float, c: float) -> tuple[float, float, float, float]:
    """Rx(a) Ry(b) Rz(c) as a unit quaternion w, x, y, z."""
    ca, sa = np.cos(0.5 * a), np.sin(0.5 * a)
    cb, sb = np.cos(0.5 * b), np.sin(0.5 * b)
    cc, sc = np.cos(0.5 * c), np.sin(0.5 * c)
    return (
        ca * cb * cc - sa * sb * sc,
        sa * cb * cc + ca * sb * sc,
        ca * sb * cc - sa * cb * sc,
        ca * cb * sc + sa * sb * cc,
    )
