"""Rotations in three dimensions: by axis and angle, Euler angles, matrix and quaternion.

Euler angles are those of Rx(a) Ry(b) Rz(c), in radians.
"""

from __future__ import annotations

import numpy as np

from gepf.common.arrays import Array
from gepf.common.compiling import numba

Angles = tuple[float, float, float]


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
    out = np.empty((3, 3))
    fill_euler_matrix(angles[0], angles[1], angles[2], out)
    return out


@numba.njit(cache=True, nogil=True)
def fill_euler_matrix(a: float, b: float, c: float, out: Array) -> None:
    """Fill out (3, 3) with Rx(a) Ry(b) Rz(c)."""
    ca, sa = np.cos(a), np.sin(a)
    cb, sb = np.cos(b), np.sin(b)
    cc, sc = np.cos(c), np.sin(c)
    out[0, 0], out[0, 1], out[0, 2] = cb * cc, -cb * sc, sb
    out[1, 0], out[1, 1], out[1, 2] = ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb
    out[2, 0], out[2, 1], out[2, 2] = sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb


@numba.njit(cache=True, nogil=True)
def unwrap_near(angle: float, reference: float) -> float:
    """`angle` plus the multiple of a full turn that brings it nearest to `reference`."""
    turns: float = np.round((reference - angle) / (2.0 * np.pi))
    return angle + 2.0 * np.pi * turns


@numba.njit(cache=True, nogil=True)
def euler_angles(rotation: Array, reference: Array | Angles) -> Angles:
    """Angles of Rx Ry Rz nearest to `reference` (3,) among the two branches and full turns."""
    sb = min(1.0, max(-1.0, rotation[0, 2]))
    if abs(sb) > 1.0 - 1e-12:  # Rx and Rz rotate about the same line: keep the third angle
        both = np.arctan2(rotation[2, 1], rotation[1, 1])
        return (
            unwrap_near(both - np.sign(sb) * reference[2], reference[0]),
            unwrap_near(np.arcsin(sb), reference[1]),
            reference[2],
        )
    a = np.arctan2(-rotation[1, 2], rotation[2, 2])
    c = np.arctan2(-rotation[0, 1], rotation[0, 0])
    b = np.arcsin(sb)
    best, nearest = (a, b, c), np.inf
    for branch in range(2):
        x = unwrap_near(a + branch * np.pi, reference[0])
        y = unwrap_near(b if branch == 0 else np.pi - b, reference[1])
        z = unwrap_near(c + branch * np.pi, reference[2])
        distance = (x - reference[0]) ** 2 + (y - reference[1]) ** 2 + (z - reference[2]) ** 2
        if distance < nearest:
            best, nearest = (x, y, z), distance
    return best


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
def handedness(axes: Array, start: int) -> float:
    """1 if the three axes of (D, 3) from `start` on are right-handed, -1 if they are left-handed."""
    x, y, z = start, start + 1, start + 2
    volume = (
        (axes[x, 1] * axes[y, 2] - axes[x, 2] * axes[y, 1]) * axes[z, 0]
        + (axes[x, 2] * axes[y, 0] - axes[x, 0] * axes[y, 2]) * axes[z, 1]
        + (axes[x, 0] * axes[y, 1] - axes[x, 1] * axes[y, 0]) * axes[z, 2]
    )
    return 1.0 if volume > 0.0 else -1.0


@numba.njit(cache=True, nogil=True)
def multiply_by(matrix: Array, factor: Array) -> None:
    """matrix = matrix @ factor in place, (3, 3), which are too small for the cost of a library call."""
    for a in range(3):
        x, y, z = matrix[a, 0], matrix[a, 1], matrix[a, 2]
        for b in range(3):
            matrix[a, b] = x * factor[0, b] + y * factor[1, b] + z * factor[2, b]
