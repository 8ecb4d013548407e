"""Places one camera of a rig by the distances of its points from the tracked surface, over all frames.

The body is fixed. The unknowns are a small rotation about the person's place, a translation, and a change of
the clock offset, which moves the surface by its velocity. The deviations come from the differences among
blocks of time (a cluster-robust covariance), as errors of successive frames are alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from common.body import vertex_normals
from common.camera import moved

Array = NDArray[np.float64]

OUTLIER_M = 0.03  # scale of the robust kernel
FARTHEST_M = 0.15  # from the surface
STEPS = 8  # of Gauss-Newton, with new closest points
UNKNOWNS = 7
BLOCK_S = 0.5  # longer than errors of the pose are alike


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The tracked surface at the time of a frame.

    vertices, normals, velocities: (V, 3) metres and metres per second, rig's frame.
    """

    time_s: float
    vertices: Array
    normals: Array
    velocities: Array


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What a camera saw: points (P, 3) in its own frame at a time of the rig; and the surface then."""

    time_s: float
    points: Array
    surface: Surface


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """How much a camera is to be moved, and its deviations.

    step: (7,) rotation about `middle` and translation in the rig's frame, radians and metres, and seconds.
    covariance: (7, 7).
    """

    middle: Array
    step: Array
    covariance: Array

    def apply(self, placed: Array, share: float = 1.0) -> Array:
        """T_rig_camera (4, 4) after a multiple of the step."""
        turn, after = rotation(share * self.step[:3]), np.eye(4)
        after[:3, :3] = turn @ placed[:3, :3]
        after[:3, 3] = turn @ (placed[:3, 3] - self.middle) + self.middle + share * self.step[3:6]
        return after


def rotation(vector: Array) -> Array:
    """The rotation (3, 3) of a small rotation vector (3,)."""
    x, y, z = vector
    turn = np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    left, _, right = np.linalg.svd(turn)
    exact: Array = left @ right
    return exact


def surfaces_of(
    times: Array, vertices: Sequence[Array | None], triangles: NDArray[np.int64]
) -> list[Surface | None]:
    """Surfaces with their velocities; None in frames without a pose, or without one before and after."""
    found = list[Surface | None]()
    for f, now in enumerate(vertices):
        before = vertices[f - 1] if f > 0 else None
        after = vertices[f + 1] if f + 1 < len(vertices) else None
        if now is None or before is None or after is None:
            found.append(None)
            continue
        velocities = (after - before) / (times[f + 1] - times[f - 1])
        found.append(
            Surface(float(times[f]), now, vertex_normals(now, triangles).astype(np.float64), velocities)
        )
    return found


def place(sights: Sequence[Sight], placed: Array) -> Placement | None:
    """Place a camera that is at T_rig_camera (4, 4) now; None if its points are nowhere near the surface."""
    if not sights:
        return None
    middle = np.mean([each.surface.vertices.mean(axis=0) for each in sights], axis=0)
    facing = [seen_part(each, placed) for each in sights]
    blocks = np.array([int(each.time_s / BLOCK_S) for each in sights])
    step = Placement(middle, np.zeros(UNKNOWNS), np.zeros((UNKNOWNS, UNKNOWNS)))
    for _ in range(STEPS):
        now = step.apply(placed)
        parts = [sums_of(*each, now, middle, step.step[6]) for each in zip(sights, facing, strict=True)]
        gram = np.sum([part[0] for part in parts], axis=0)
        if np.linalg.matrix_rank(gram, hermitian=True) < UNKNOWNS:
            return None
        move = -np.linalg.solve(gram, np.sum([part[1] for part in parts], axis=0))
        onward = Placement(middle, move, step.covariance).apply(now)
        step = Placement(middle, between(placed, onward, middle, step.step[6] + move[6]), step.covariance)
    slopes = np.array(
        [sum(p[1] for p, b in zip(parts, blocks, strict=True) if b == k) for k in np.unique(blocks)]
    )
    spread = slopes.T @ slopes * len(slopes) / max(1, len(slopes) - 1)
    inverse = np.linalg.inv(gram)
    return Placement(middle, step.step, inverse @ spread @ inverse)


def between(placed: Array, onward: Array, middle: Array, seconds: float) -> Array:
    """The step (7,) from one T_rig_camera (4, 4) to another, for a rotation about `middle`."""
    turn = onward[:3, :3] @ placed[:3, :3].T
    vector = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    shift = onward[:3, 3] - (rotation(vector) @ (placed[:3, 3] - middle) + middle)
    return np.concatenate([vector, shift, [seconds]])


def seen_part(sight: Sight, placed: Array) -> tuple[KDTree, NDArray[np.int64]]:
    """The vertices that face the camera, for searching, and their indices."""
    surface = sight.surface
    towards = placed[:3, 3] - surface.vertices
    facing = np.flatnonzero(np.sum(surface.normals * towards, axis=1) > 0.0)
    vertices = surface.vertices + (sight.time_s - surface.time_s) * surface.velocities
    return KDTree(vertices[facing]), facing


def sums_of(
    sight: Sight, part: tuple[KDTree, NDArray[np.int64]], placed: Array, middle: Array, seconds: float
) -> tuple[Array, Array]:
    """J^T W J (7, 7) and J^T W r (7,) of one image, with points moved by T_rig_camera `placed`."""
    tree, facing = part
    points = moved(sight.points, placed)
    apart, nearest = tree.query(points, distance_upper_bound=FARTHEST_M)
    points, vertices = points[np.isfinite(apart)], facing[nearest[np.isfinite(apart)]]
    normals, velocities = sight.surface.normals[vertices], sight.surface.velocities[vertices]
    later = sight.time_s + seconds - sight.surface.time_s
    residuals = np.sum(normals * (points - sight.surface.vertices[vertices] - later * velocities), axis=1)
    weights = (OUTLIER_M**2 / (OUTLIER_M**2 + residuals**2)) ** 2
    slopes = np.hstack(
        [
            np.cross(points - middle, normals),
            normals,
            -np.sum(normals * velocities, axis=1)[:, None],
        ]
    )
    return (slopes * weights[:, None]).T @ slopes, slopes.T @ (weights * residuals)
