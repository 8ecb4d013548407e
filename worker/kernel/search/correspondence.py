"""The closest visible model point of each observed point (step 4c), exactly, leaf by leaf.

Observed points come in tiles, model points in leaves and groups of leaves, all of them neighbours, so each
has a small bounding box. A guess bounds each observed point's distance: what it had before, or the best of
the leaf that is centred nearest. The bounds of a tile rule out most groups, and most leaves of the others, by
the distance of the boxes; those of its points most of what is left, which is searched point by point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.compiling import numba
from worker.kernel.observation import BLOCK, TILE
from worker.kernel.tiles import box_within, boxes_within, largest_of, lowest_bit, search_lanes

Points = NDArray[np.float32]
Indices = NDArray[np.int64]
Numbers = NDArray[np.uint32]

LOOSER, TINY = np.float32(1.0 + 1e-6), np.float32(1e-12)  # so that a guess itself is found again


class SearchBuffers(NamedTuple):
    """Buffers for a search; whatever they held before is written over, a guess aside."""

    model: Points  # (M, 3) visible points
    last_visible: Numbers  # (M,) the vertices of the last search
    remapped: Numbers  # (M,) their places among the visible ones now
    starts: Indices  # (K + 1,) where their leaves begin, and the last ends
    leaves: Points  # (6, K) bounding boxes, padded to whole tiles with what is infinitely far
    groups: Points  # (6, K / TILE) those of TILE leaves in a row, padded alike
    centre_distances: Points  # (K,) squared distances of the leaves' centres
    closest: Numbers  # (P,) which of them
    squared: Points  # (P,)
    largest: Points  # (P / TILE,) of a tile's
    weights: NDArray[np.float64]  # (P,)


def make_search_buffers(points: int, vertices: int, leaves: int) -> SearchBuffers:
    """Allocate buffers for so many observed points, padded, model points and leaves."""
    groups = -(-leaves // TILE)
    return SearchBuffers(
        np.empty((vertices, 3), dtype=np.float32),
        np.empty(vertices, dtype=np.uint32),
        np.empty(vertices, dtype=np.uint32),
        np.empty(leaves + 1, dtype=np.int64),
        np.empty((6, groups * TILE), dtype=np.float32),
        np.empty((6, -(-groups // TILE) * TILE), dtype=np.float32),
        np.empty(leaves, dtype=np.float32),
        np.empty(points, dtype=np.uint32),
        np.empty(points, dtype=np.float32),
        np.empty(points // TILE, dtype=np.float32),
        np.empty(points),
    )


def boxes_of(points: Points, size: int) -> Points:
    """Bounding boxes (6, K) of every `size` points in a row, of points (3, P)."""
    boxes = np.empty((6, points.shape[1] // size), dtype=np.float32)
    enclose_rows(points, size, boxes)
    return boxes


@numba.njit(cache=True, nogil=True)
def enclose_rows(points: Points, size: int, boxes: Points) -> None:
    """Fill boxes (6, K): lowest and highest x, y, z of every `size` points (3, P) in a row."""
    for a in range(3):
        for k in range(boxes.shape[1]):
            low = high = points[a, k * size]
            for i in range(k * size + 1, (k + 1) * size):
                low = min(low, points[a, i])
                high = max(high, points[a, i])
            boxes[a, k], boxes[3 + a, k] = low, high


@numba.njit(cache=True, nogil=True, fastmath={"nnan", "nsz"})
def bounding_boxes(points: Points, starts: Indices, boxes: Points) -> None:
    """Fill boxes (6, K): lowest and highest x, y, z of the points from each start (K + 1,) to the next."""
    for k in range(len(starts) - 1):
        first = np.uint64(starts[k])  # an unsigned index needs no test for one that counts from the end
        left, top, front = points[first, 0], points[first, 1], points[first, 2]
        right, bottom, back = left, top, front
        for n in range(1, starts[k + 1] - starts[k]):
            i = first + np.uint64(n)
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            left, right = min(left, x), max(right, x)
            top, bottom = min(top, y), max(bottom, y)
            front, back = min(front, z), max(back, z)
        boxes[0, k], boxes[1, k], boxes[2, k] = left, top, front
        boxes[3, k], boxes[4, k], boxes[5, k] = right, bottom, back


@numba.njit(cache=True, nogil=True)
def closest_points(
    observed: Points, blocks: Points, tiles: Points, leaves: int, search: SearchBuffers
) -> None:
    """Find the closest of search.model to each observed point (3, blocks * BLOCK): index, squared distance.

    `blocks` and `tiles` are the observed points' bounding boxes, `leaves` the number of the model's. Of
    equally close model points the one met first wins; the order in which they are met depends on the
    arguments alone.
    """
    model, starts, squared, closest = search.model, search.starts, search.squared, search.closest
    centre_distances, bounds = search.centre_distances, search.largest  # once: each use counts references
    groups = bound_leaves(leaves, search)
    closest[:] = 0
    squared[:] = np.inf
    for b in range(blocks.shape[1]):
        compare_centres(blocks, b, search.leaves, leaves, centre_distances)
        first = smallest(centre_distances, leaves)
        for tile in range(b * BLOCK, (b + 1) * BLOCK, TILE):
            search_lanes(  # type: ignore[call-arg]
                observed, tile, model, starts[first], starts[first + 1], squared, closest
            )
            bounds[tile // TILE] = largest_of(squared, tile)
    search_tiles(observed, tiles, groups, search)


@numba.njit(cache=True, nogil=True)
def closest_points_from_guess(observed: Points, tiles: Points, leaves: int, search: SearchBuffers) -> None:
    """Find closest points as `closest_points`, from a guess in search.closest: any places in the model."""
    groups = bound_leaves(leaves, search)
    bound_tiles(observed, search)
    search_tiles(observed, tiles, groups, search)


@numba.njit(cache=True, nogil=True)
def bound_leaves(leaves: int, search: SearchBuffers) -> int:
    """Fill the boxes of all leaves and groups; returns the number of groups."""
    boxes, groups = search.leaves, search.groups
    bounding_boxes(search.model, search.starts[: leaves + 1], boxes)
    count = (leaves + TILE - 1) // TILE
    boxes[:, leaves : count * TILE] = np.inf
    groups[:, count:] = np.inf
    for g in range(count):
        for a in range(3):
            low, high = boxes[a, g * TILE], boxes[3 + a, g * TILE]
            for k in range(g * TILE + 1, min(leaves, (g + 1) * TILE)):
                low = min(low, boxes[a, k])
                high = max(high, boxes[3 + a, k])
            groups[a, g], groups[3 + a, g] = low, high
    return count


@numba.njit(cache=True, nogil=True, fastmath={"contract", "nsz", "nnan"})
def compare_centres(one: Points, k: int, boxes: Points, count: int, centre_distances: Points) -> None:
    """Squared distances of the centre of box k of `one` from those of the first of `boxes`, doubled."""
    x, y, z = one[0, k] + one[3, k], one[1, k] + one[4, k], one[2, k] + one[5, k]
    for j in range(count):
        dx = x - boxes[0, j] - boxes[3, j]
        dy = y - boxes[1, j] - boxes[4, j]
        dz = z - boxes[2, j] - boxes[5, j]
        centre_distances[j] = dx * dx + dy * dy + dz * dz


@numba.njit(cache=True, nogil=True)
def smallest(values: Points, count: int) -> int:
    """Place of the least of the first `count` values."""
    best, least = 0, values[0]
    for k in range(1, count):
        if values[k] < least:
            best, least = k, values[k]
    return best


@numba.njit(cache=True, nogil=True, fastmath={"contract", "nsz", "nnan"})
def bound_tiles(observed: Points, search: SearchBuffers) -> None:
    """Bound squared distances by those of the guesses, and a little more, and find each tile's largest."""
    model, squared, closest, bounds = search.model, search.squared, search.closest, search.largest
    for t in range(len(bounds)):
        largest = np.float32(0.0)
        for i in range(t * TILE, (t + 1) * TILE):
            m = closest[i]
            dx, dy, dz = (
                observed[0, i] - model[m, 0],
                observed[1, i] - model[m, 1],
                observed[2, i] - model[m, 2],
            )
            squared[i] = LOOSER * (dx * dx + dy * dy + dz * dz) + TINY
            largest = max(largest, squared[i])
        bounds[t] = largest


@numba.njit(cache=True, nogil=True)
def search_tiles(observed: Points, tiles: Points, groups: int, search: SearchBuffers) -> None:
    """Lower all squared distances, of which each tile's largest is given, to those of the closest points."""
    model, starts, squared, closest = search.model, search.starts, search.squared, search.closest
    boxes, around, bounds = search.leaves, search.groups, search.largest
    for t in range(len(bounds)):
        tile, largest = t * TILE, bounds[t]
        for first in range(0, groups, TILE):
            near: int = boxes_within(tiles, t, around, first, largest)  # type: ignore[call-arg]
            while near != 0:
                leaf = (first + lowest_bit(near)) * TILE
                near &= near - 1
                within: int = boxes_within(tiles, t, boxes, leaf, largest)
                lower = False
                while within != 0:
                    k = np.uint64(leaf + lowest_bit(within))
                    within &= within - 1
                    if box_within(observed, tile, boxes, k, squared):
                        search_lanes(
                            observed, tile, model, starts[k], starts[k + np.uint64(1)], squared, closest
                        )
                        lower = True
                if lower:
                    largest = largest_of(squared, tile)
