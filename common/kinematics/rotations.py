"""Rotations in three dimensions: by axis and angle, Euler angles, matrix, vector and quaternion.

Euler angles are those of Rx(a) Ry(b) Rz(c), in radians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def fill_rotation(x: float, y: float, z: float, angle: float, out: Array) -> None:
    """Fill the first three columns of out with the rotation about a unit axis (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    k = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k


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
def unwrap_near(angle: float, reference: float) -> float:
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
        best[1] = unwrap_near(np.arcsin(sb), reference[1])
        both = np.arctan2(rotation[2, 1], rotation[1, 1])
        best[0] = unwrap_near(both - np.sign(sb) * best[2], reference[0])
        return best
    a = np.arctan2(-rotation[1, 2], rotation[2, 2])
    c = np.arctan2(-rotation[0, 1], rotation[0, 0])
    b = np.arcsin(sb)
    nearest = np.inf
    for branch in range(2):
        x = unwrap_near(a + branch * np.pi, reference[0])
        y = unwrap_near(b if branch == 0 else np.pi - b, reference[1])
        z = unwrap_near(c + branch * np.pi, reference[2])
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
def matrix_product(one: Array, other: Array) -> Array:
    """one @ other, (3, 3): so small that a library's call costs more than the product."""
    out = np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            out[a, b] = one[a, 0] * other[0, b] + one[a, 1] * other[1, b] + one[a, 2] * other[2, b]
    return out
