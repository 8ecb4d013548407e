"""Other people and things beside the tracked bodies.

They have no model. While there is a gap between them and every body, they form separate components of the
foreground. Once the gap has closed, whatever is nearer to their points in the last frame than to a body's
surface still counts as theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gepf.common.arrays import Array, Mask
from gepf.common.camera import points_of
from gepf.common.compiling import numba
from gepf.coordinator.scene.noise import DepthNoise, margin_at
from gepf.coordinator.scene.scene import FOREGROUND, NOBODY, Depth, SceneView
from gepf.coordinator.scene.segmentation import measure_distances

Points = NDArray[np.float32]  # (N, 3), camera frame, metres


def mark_foreign(view: SceneView, nearest: Depth, nearest_new: Depth) -> Mask:
    """Pixels (H, W) of other people and things, given their points in the frame before, `view.foreign`.

    nearest: distances (H, W) from the nearest body. nearest_new: the same of the bodies that were detected a
    short time ago, whose limbs may not be where they should.
    """
    foreign = mark_apart(view, nearest)
    if len(view.foreign):
        points = view.foreign.astype(np.float64)
        distances = measure_distances(view, points) + view.settings.segmentation.cell_m
        foreign |= (view.marks == FOREGROUND) & (distances < nearest) & np.isinf(nearest_new)
    return foreign


def points_beside(view: SceneView, foreign: Mask, surfaces: Sequence[Array]) -> Points:
    """Some of the foreign points (N, 3) around the surfaces (V, 3) of bodies, camera frame, metres."""
    if not surfaces or not foreign.any():
        return NOBODY
    limits, surface = view.settings.segmentation, np.concatenate(surfaces)
    points = points_of(view.depth, view.camera, foreign)
    low, high = surface.min(axis=0) - limits.beside_m, surface.max(axis=0) + limits.beside_m
    points = points[np.all((points > low) & (points < high), axis=1)]
    return points[:: 1 + len(points) // limits.beside_points].astype(np.float32)


def mark_apart(view: SceneView, nearest: Depth) -> Mask:
    """Pixels (H, W) of other people and things beside bodies, from the distances to the nearest body.

    They are connected components of the foreground that are farther than `near_m` from every body, come
    within `reach_m` of a body, extend beyond that distance, and are too large to be a limb.
    """
    limits = view.settings.segmentation
    min_area = limits.min_person_m2 * view.camera.fx * view.camera.fy
    free = view.marks == FOREGROUND
    return grow_apart(
        view.depth, free, nearest, view.noise, limits.near_m, limits.reach_m, limits.step_m, min_area
    )


@numba.njit(cache=True, nogil=True)
def grow_apart(
    depth: Depth,
    free: Mask,
    distances: Depth,
    noise: DepthNoise,
    near_m: float,
    reach_m: float,
    step_m: float,
    min_area: float,
) -> Mask:
    """Pixels (H, W) as in `mark_apart`; `min_area` is in pixels times z^2."""
    rows, columns = depth.shape
    apart = np.zeros(depth.shape, dtype=np.bool_)
    grown = np.empty(rows * columns, dtype=np.int64)
    nearby, unused = distances.ravel(), free.ravel()
    for start in range(rows * columns):
        if not unused[start] or nearby[start] <= near_m or nearby[start] > reach_m:
            continue
        grown[0], count, place, area, beyond = start, 1, 0, 0.0, False
        unused[start] = False
        while place < count:
            row, column = grown[place] // columns, grown[place] % columns
            place += 1
            z = depth[row, column]
            area += z * z
            beyond |= distances[row, column] > reach_m
            step = step_m + margin_at(z, noise)
            for k in range(4):
                r, c = row + (k == 1) - (k == 0), column + (k == 3) - (k == 2)
                if not (0 <= r < rows and 0 <= c < columns) or not free[r, c]:
                    continue
                if distances[r, c] > near_m and abs(depth[r, c] - z) < step:
                    free[r, c] = False
                    grown[count] = r * columns + c
                    count += 1
        if beyond and area >= min_area:
            for k in range(count):
                apart[grown[k] // columns, grown[k] % columns] = True
    return apart
