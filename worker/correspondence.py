"""The closest visible model point of each observed point (step 4c), exactly, leaf by leaf.

Observed points come in blocks and tiles, model points in leaves, all of them neighbours, so each has a small
bounding box. A block of observed points rules out most leaves by the distance of the boxes, a tile of it
most of the others; what is left is searched point by point.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from worker.lanes import search_lanes
from worker.observation import BLOCK, TILE

Points = NDArray[np.float32]
Indices = NDArray[np.int64]


class Search(NamedTuple):
    """Room for a search; whatever it held before is written over."""

    model: Points  # (M, 3) visible points
    starts: Indices  # (K + 1,) where their leaves begin, and the last ends
    leaves: Points  # (6, K) bounding boxes
    apart: Points  # (K,) squared distances of boxes
    between: Points  # (K,) and of their centres
    candidates: Indices  # (K,)
    boxes: Points  # (6, K) those of the candidates
    closest: NDArray[np.int32]  # (P,) which of them
    squared: Points  # (P,)


def lay_out_search(points: int, vertices: int, leaves: int) -> Search:
    """Room for as many observed points, padded, model points and leaves."""
    return Search(
        np.empty((vertices, 3), dtype=np.float32),
        np.empty(leaves + 1, dtype=np.int64),
        np.empty((6, leaves), dtype=np.float32),
        np.empty(leaves, dtype=np.float32),
        np.empty(leaves, dtype=np.float32),
        np.empty(leaves, dtype=np.int64),
        np.empty((6, leaves), dtype=np.float32),
        np.empty(points, dtype=np.int32),
        np.empty(points, dtype=np.float32),
    )


def boxes_of(points: Points, size: int) -> Points:
    """Bounding boxes (6, K) of every `size` points in a row."""
    boxes = np.empty((6, len(points) // size), dtype=np.float32)
    bounding_boxes(points, np.arange(0, len(points) + 1, size), boxes)
    return boxes


@numba.njit(cache=True, nogil=True)
def bounding_boxes(points: Points, starts: Indices, boxes: Points) -> None:
    """Fill boxes (6, K): lowest and highest x, y, z of the points from each start (K + 1,) to the next."""
    for k in range(len(starts) - 1):
        for a in range(3):
            low = high = points[starts[k], a]
            for i in range(starts[k] + 1, starts[k + 1]):
                low = min(low, points[i, a])
                high = max(high, points[i, a])
            boxes[a, k], boxes[3 + a, k] = low, high


@numba.njit(cache=True, nogil=True, fastmath={"contract", "nsz", "nnan"})
def compare_boxes(one: Points, k: int, boxes: Points, count: int, apart: Points, between: Points) -> None:
    """Squared distances of box k of `one` from the first `count` of `boxes`; between centres, doubled."""
    x, y, z, right, bottom, far = one[0, k], one[1, k], one[2, k], one[3, k], one[4, k], one[5, k]
    none = np.float32(0.0)
    for j in range(count):
        dx = max(max(x - boxes[3, j], boxes[0, j] - right), none)
        dy = max(max(y - boxes[4, j], boxes[1, j] - bottom), none)
        dz = max(max(z - boxes[5, j], boxes[2, j] - far), none)
        apart[j] = dx * dx + dy * dy + dz * dz
        dx = x + right - boxes[0, j] - boxes[3, j]
        dy = y + bottom - boxes[1, j] - boxes[4, j]
        dz = z + far - boxes[2, j] - boxes[5, j]
        between[j] = dx * dx + dy * dy + dz * dz


@numba.njit(cache=True, nogil=True)
def smallest(values: Points, count: int) -> int:
    """Place of the least of the first `count` values."""
    best = 0
    for k in range(1, count):
        if values[k] < values[best]:
            best = k
    return best


@numba.njit(cache=True, nogil=True)
def closest_points(observed: Points, blocks: Points, tiles: Points, leaves: int, search: Search) -> None:
    """For observed points (3, blocks * BLOCK) the closest of search.model: its index and squared distance.

    `blocks` and `tiles` are the observed points' bounding boxes, `leaves` the number of the model's. Of
    equally close model points the one met first wins; the order in which they are met depends on the
    arguments alone.
    """
    model, starts, squared, closest = search.model, search.starts, search.squared, search.closest
    apart, between = search.apart, search.between  # taken out once: each time references are counted
    bounding_boxes(model, starts[: leaves + 1], search.leaves)
    closest[:] = 0
    squared[:] = np.inf
    for b in range(blocks.shape[1]):
        compare_boxes(blocks, b, search.leaves, leaves, apart, between)
        first = smallest(between, leaves)
        start, stop, largest = starts[first], starts[first + 1], np.float32(0.0)
        for i in range(b * BLOCK, (b + 1) * BLOCK, TILE):
            largest = max(largest, search_lanes(observed, i, model, start, stop, squared, closest))  # type: ignore[call-arg]
        apart[first] = np.inf
        kept = keep_candidates(search, leaves, largest)
        if kept > 0:
            for i in range(b * BLOCK, (b + 1) * BLOCK, TILE):
                compare_boxes(tiles, i // TILE, search.boxes, kept, apart, between)
                search_tile(observed, i, kept, search)


@numba.njit(cache=True, nogil=True)
def keep_candidates(search: Search, leaves: int, largest: np.float32) -> int:
    """Copy the boxes of those leaves that are less than `largest` apart; gives their number."""
    apart, candidates, boxes, boxes_of_leaves = search.apart, search.candidates, search.boxes, search.leaves
    kept = 0
    for k in range(leaves):
        if apart[k] < largest:
            candidates[kept] = k
            for a in range(6):
                boxes[a, kept] = boxes_of_leaves[a, k]
            kept += 1
    return kept


@numba.njit(cache=True, nogil=True)
def search_tile(observed: Points, tile: int, kept: int, search: Search) -> None:
    """Search the candidate leaves for the tile that begins at a point, the one centred nearest first."""
    model, starts, squared, closest = search.model, search.starts, search.squared, search.closest
    apart, candidates = search.apart, search.candidates
    largest = np.float32(0.0)
    for i in range(tile, tile + TILE):
        largest = max(largest, squared[i])
    first = smallest(search.between, kept)
    for turn in range(-1, kept):
        c = first if turn < 0 else turn
        if apart[c] < largest and (turn < 0 or c != first):
            start, stop = starts[candidates[c]], starts[candidates[c] + 1]
            largest = search_lanes(observed, tile, model, start, stop, squared, closest)  # type: ignore[call-arg]
