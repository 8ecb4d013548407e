"""A room around whoever moves in it: floor, walls, and furniture that stands behind and beside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Size and middle, metres: to the right, up from the floor, away from the camera."""

BOXES: tuple[Box, ...] = (
    ((9.0, 0.1, 7.0), (0.0, -0.05, 3.0)),  # floor
    ((9.0, 3.0, 0.1), (0.0, 1.5, 4.8)),  # back wall
    ((0.1, 3.0, 7.0), (-2.6, 1.5, 3.0)),  # left wall
    ((0.9, 1.7, 0.45), (1.75, 0.85, 4.5)),  # cabinet
    ((1.3, 0.05, 0.7), (-1.6, 0.74, 4.2)),  # table
    *(((0.06, 0.72, 0.06), (-1.6 + x, 0.36, 4.2 + z)) for x in (-0.6, 0.6) for z in (-0.3, 0.3)),
    ((0.4, 0.35, 0.3), (-1.7, 0.94, 4.25)),  # what stands on the table
    ((0.45, 0.45, 0.45), (1.6, 0.225, 3.6)),  # crate
)


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A surface that stands still: vertices (V, 3) in the camera frame, metres, and triangles (T, 3)."""

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]


def furnish(camera_height_m: float) -> Room:
    """The room, seen by a level camera at that height."""
    boxes = [trimesh.creation.box(size).apply_translation(at) for size, at in BOXES]
    x, up, z = np.concatenate([box.vertices for box in boxes]).T
    firsts = np.cumsum([0, *(len(box.vertices) for box in boxes[:-1])])
    triangles = np.concatenate([box.faces + first for box, first in zip(boxes, firsts, strict=True)])
    # y goes down in the camera frame: mirrored, so that triangles are turned round to face outside again
    return Room(np.stack([x, camera_height_m - up, z], axis=1), triangles[:, ::-1].copy())
