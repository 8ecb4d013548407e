"""Places the cameras of a rig by the distances of their points from the tracked surface, over all frames.

The pose of the body is fixed in each frame. Unknown are, for each camera, a small rotation about the person's
place, a translation, and a change of the clock offset, which moves the surface by its velocity; and, for all
cameras alike, how far the person's surface is outside of the model's. Without it, opposite cameras would be
placed too near or too far.

The deviations are from the jackknife, by blocks of time and by links: errors of the pose are alike within a
block, errors of the shape within a link. To them the distance of the surfaces adds, which is not the same on
all sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from common.body import BodyModel, vertex_normals
from common.camera import inverse, moved
from common.kinematics import pose_vertices

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

OUTLIER_M = 0.03  # scale of the robust kernel
FARTHEST_M = 0.15  # from the surface
STEPS = 4  # of Gauss-Newton, with new closest points
UNKNOWNS = 7  # of a camera
SHAPE_M = 0.005  # deviation of the distance of the surfaces from side to side (`dance`, `turn`, one camera)
BLOCK_S = 0.5  # longer than errors of the pose are alike


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """The tracked surface at the time of a frame.

    vertices, normals, velocities: (V, 3) metres and metres per second, rig's frame. links: (V,).
    """

    time_s: float
    vertices: Array
    normals: Array
    velocities: Array
    links: Indices


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What a camera saw: points (P, 3) in its own frame, `delay_s` after the time of the surface."""

    camera: int
    delay_s: float
    points: Array
    surface: Surface


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where cameras (C) are relative to the first, and how sure that is.

    placed: (C, 4, 4). steps: (C, 7) the changes from before. deviations: (C, 7) of the rotation and position
    at the person, radians and metres in the rig's axes, and of the clock. outside: metres that the person's
    surface is outside of the model's.
    """

    placed: Array
    steps: Array
    deviations: Array
    outside: float


def surfaces_of(times: Array, known: Sequence[bool], model: BodyModel, poses: Array) -> list[Surface | None]:
    """Surfaces in poses (F, D); None if the pose, or the one before or after it, is not known."""
    vertices, found = pose_vertices(model, poses), list[Surface | None]()
    links = model.skin_links[:, 0].astype(np.int64)
    for f, now in enumerate(vertices):
        if not 0 < f < len(poses) - 1 or not all(known[f - 1 : f + 2]):
            found.append(None)
            continue
        velocities = (vertices[f + 1] - vertices[f - 1]) / (times[f + 1] - times[f - 1])
        normals = vertex_normals(now, model.triangles).astype(np.float64)
        found.append(Surface(float(times[f]), now, normals, velocities, links))
    return found


def place(sights: Sequence[Sight], placed: Array, *, shape_known: bool = False) -> Placement | None:
    """Place cameras that are at (C, 4, 4) now; None if the points do not determine it.

    With `shape_known` the surfaces are not moved apart.
    """
    cameras, total = len(placed), len(placed) * UNKNOWNS + 1
    if {each.camera for each in sights} != set(range(cameras)):
        return None
    middle = np.mean([each.surface.vertices.mean(axis=0) for each in sights], axis=0)
    parts = [seen_part(each, placed[each.camera]) for each in sights]
    starts = np.array([each.surface.time_s for each in sights]) / BLOCK_S
    blocks = np.unique(starts.astype(np.int64), return_inverse=True)[1]
    links = 1 + max(int(each.surface.links.max()) for each in sights)
    now, values, free = placed.copy(), np.zeros(total), total - shape_known
    for _ in range(STEPS):
        grams = np.zeros((blocks.max() + 1, links, total, total))
        slopes = np.zeros(grams.shape[:-1])
        for sight, part, block in zip(sights, parts, blocks, strict=True):
            own = np.append(np.arange(UNKNOWNS * sight.camera, UNKNOWNS * (sight.camera + 1)), total - 1)
            jacobian, residuals, of_links = linearise(sight, part, now[sight.camera], middle, values[own])
            weighted = jacobian * ((OUTLIER_M**2 / (OUTLIER_M**2 + residuals**2)) ** 2)[:, None]
            places = of_links[:, None, None], own[:, None], own
            np.add.at(grams[block], places, weighted[:, :, None] * jacobian[:, None, :])
            np.add.at(slopes[block], (of_links[:, None], own), weighted * residuals[:, None])
        gram, slope = grams.sum(axis=(0, 1)), slopes.sum(axis=(0, 1))
        if np.linalg.matrix_rank(gram, hermitian=True) < total or len(slopes) < 2:
            return None
        move = -np.linalg.solve(gram[:free, :free], slope[:free])
        values[:free] += move
        for c in range(cameras):
            now[c] = turned_about(middle, move[UNKNOWNS * c :][:6]) @ now[c]
    by_thickness = np.linalg.solve(gram[:-1, :-1], gram[:-1, -1])[None] * SHAPE_M
    variance = relative(by_thickness, cameras)[0] ** 2
    for axis in (0, 1):  # the jackknife
        left = gram - grams.sum(axis=axis), slope - slopes.sum(axis=axis)
        without = relative(-np.linalg.solve(left[0], left[1][..., None])[..., 0], cameras)
        variance += (len(without) - 1.0) * np.var(without, axis=0)
    return Placement(
        placed=np.array([inverse(now[0]) @ each for each in now]),
        steps=relative(values[None], cameras)[0],
        deviations=np.sqrt(variance),
        outside=float(values[-1]),
    )


def relative(values: Array, cameras: int) -> Array:
    """The unknowns (N, C, 7) of cameras minus those of the first, from all unknowns (N, U)."""
    each = values[:, : cameras * UNKNOWNS].reshape(len(values), cameras, UNKNOWNS)
    return each - each[:, :1]


def turned_about(middle: Array, step: Array) -> Array:
    """The rigid transform (4, 4) of a small rotation vector about `middle` and a translation, (6,)."""
    x, y, z = step[:3]
    left, _, right = np.linalg.svd(np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]))
    after = np.eye(4)
    after[:3, :3] = left @ right
    after[:3, 3] = middle - after[:3, :3] @ middle + step[3:]
    return after


def seen_part(sight: Sight, placed: Array) -> tuple[KDTree, Indices]:
    """The vertices that face the camera, for searching, and their indices."""
    surface = sight.surface
    towards = placed[:3, 3] - surface.vertices
    facing = np.flatnonzero(np.sum(surface.normals * towards, axis=1) > 0.0)
    return KDTree((surface.vertices + sight.delay_s * surface.velocities)[facing]), facing


def linearise(
    sight: Sight, part: tuple[KDTree, Indices], placed: Array, middle: Array, values: Array
) -> tuple[Array, Array, Indices]:
    """The Jacobian (P, 8), the residuals (P,), metres, and the links (P,), of points of a camera.

    placed: its T_rig_camera (4, 4). values: (8,) its unknowns so far, and the distance of the surfaces.
    """
    tree, facing = part
    points = moved(sight.points, placed)
    apart, nearest = tree.query(points, distance_upper_bound=FARTHEST_M)
    points, vertices = points[np.isfinite(apart)], facing[nearest[np.isfinite(apart)]]
    normals, velocities = sight.surface.normals[vertices], sight.surface.velocities[vertices]
    model = sight.surface.vertices[vertices] + (sight.delay_s + values[6]) * velocities
    residuals = np.sum(normals * (points - model), axis=1) - values[7]
    along, ones = np.sum(normals * velocities, axis=1), np.ones(len(points))
    jacobian = np.column_stack([np.cross(points - middle, normals), normals, -along, -ones])
    return jacobian, residuals, sight.surface.links[vertices]
