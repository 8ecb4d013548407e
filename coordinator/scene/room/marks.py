"""Which pixels show the room: on floor or walls or beyond, or where the background was.

What is deeper than the background is not the room for that: somebody may come through a door.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from coordinator.scene.noise import margin_at

Array = NDArray[np.float64]
Depth = NDArray[np.float32]
Lens = tuple[float, float, float, float]  # fx, fy, cx, cy

NO_DEPTH, FOREGROUND, ROOM, PLANE = 0, 1, 2, 3
TWO_SAMPLES = 1.4  # the background's depth is a sample, too


@numba.njit(cache=True, nogil=True, error_model="numpy")
def mark_room(
    depth: Depth, background: Depth, lens: Lens, planes: Array, growth: float, marks: NDArray[np.uint8]
) -> None:
    """Fill marks (H, W) with NO_DEPTH, FOREGROUND, ROOM (background) or PLANE.

    depth and background (H, W) in metres; the lens is that of this window; planes (P, 3) as in `Planes`.
    """
    fx, fy, cx, cy = lens
    rows, columns = depth.shape
    for v in range(rows):
        y = (v - cy) / fy
        for u in range(columns):
            z = depth[v, u]
            if not z > 0.0:
                marks[v, u] = NO_DEPTH
                continue
            x, margin = (u - cx) / fx, margin_at(z, growth)
            inverse = 1.0 / z
            highest = inverse - margin * inverse * inverse
            mark = FOREGROUND
            for p in range(len(planes)):
                if planes[p, 0] * x + planes[p, 1] * y + planes[p, 2] > highest:
                    mark = PLANE
            if mark == FOREGROUND and abs(z - background[v, u]) < TWO_SAMPLES * margin:
                mark = ROOM
            marks[v, u] = mark
