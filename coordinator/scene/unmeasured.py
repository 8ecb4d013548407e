"""What it says that nothing was measured in a pixel: how often that happens on the body, and beside it.

A camera measures nothing in the shadow of its own light, at edges and on what is dark or shines, be that the
room or somebody's hair. Where it misses more of the room than of the body, the body is hardly there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from common.frame import EMPTY, SUBJECT, UNMEASURED
from coordinator.scene.room.marks import Lens

Array = NDArray[np.float64]
Kinds = NDArray[np.uint8]
Flags = NDArray[np.bool_]

SQUARE = 0.04  # metres a side: a body's outline may be off by one of them


def tell_emptiness(surface: Array, lens: Lens, kinds: Kinds) -> float:
    """From 0 to 1, how surely a body is not where nothing was measured.

    An unmeasured pixel shows the room with probability p = r / (r + b), r the share of the room's pixels that
    are unmeasured and b that of the body's. It says by how much that is likelier than the body: 2 p - 1.

    Args:
        surface: Points (V, 3) all over the body as it was two frames ago, metres.
        lens: Of the window.
        kinds: The window's pixels (H, W).
    """
    side = max(1, int(lens[0] * SQUARE / max(SQUARE, float(np.median(surface[:, 2])))))
    covered = np.zeros((kinds.shape[0] // side + 3, kinds.shape[1] // side + 3), dtype=np.bool_)  # and a rim
    cover(np.ascontiguousarray(surface, dtype=np.float64), lens, side, covered)
    body, body_missed, room, room_missed = count_missed(kinds, side, covered)
    missed = (body_missed + 1) / (body + 2)  # rule of succession
    beside = (room_missed + missed) / (room + 1)  # as the body, where nothing is known of the room
    return max(0.0, (beside - missed) / (beside + missed))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def cover(points: Array, lens: Lens, side: int, covered: Flags) -> None:
    """Mark the squares (R, C) in which points (N, 3) are; the first row and column lie outside it."""
    fx, fy, cx, cy = lens
    rows, columns = covered.shape
    for n in range(len(points)):
        z = points[n, 2]
        if z > 0.0:
            u, v = (cx + fx * points[n, 0] / z) // side, (cy + fy * points[n, 1] / z) // side
            if -1.0 <= u < columns - 1 and -1.0 <= v < rows - 1:
                covered[int(v) + 1, int(u) + 1] = True


@numba.njit(cache=True, nogil=True)
def count_missed(kinds: Kinds, side: int, covered: Flags) -> tuple[int, int, int, int]:
    """Pixels well inside what is covered that are the subject's or unmeasured, and how many are unmeasured.

    And the same of pixels that are empty or unmeasured in squares that are not covered.
    """
    body = body_missed = room = room_missed = 0
    for r in range(1, covered.shape[0] - 1):
        for c in range(1, covered.shape[1] - 1):
            part = kinds[(r - 1) * side : r * side, (c - 1) * side : c * side]
            if not covered[r, c]:
                seen, missed = count_two(part, EMPTY)
                room, room_missed = room + seen, room_missed + missed
            elif covered[r - 1 : r + 2, c - 1 : c + 2].all():
                seen, missed = count_two(part, SUBJECT)
                body, body_missed = body + seen, body_missed + missed
    return body, body_missed, room, room_missed


@numba.njit(cache=True, nogil=True)
def count_two(kinds: Kinds, kind: int) -> tuple[int, int]:
    """How many pixels (H, W) are unmeasured or of a kind, and how many are unmeasured."""
    seen = missed = 0
    for v in range(kinds.shape[0]):
        for u in range(kinds.shape[1]):
            missed += kinds[v, u] == UNMEASURED
            seen += kinds[v, u] == UNMEASURED or kinds[v, u] == kind
    return seen, missed
