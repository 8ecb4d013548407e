"""The closest visible model point of each observed point (step 4c), exactly, block against block.

Observed and model points come in an order that keeps neighbours together, so a block of either has a
small bounding box, and the distance of two boxes rules most pairs of blocks out.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from worker.observation import BLOCK

Points = NDArray[np.float32]
Indices = NDArray[np.int32]

MODEL_BLOCK = 16


@numba.njit(cache=True, nogil=True)
def bounding_boxes(points: Points, block: int) -> Points:
    """Lowest and highest corner (blocks, 2, 3) of every `block` points in a row."""
    count = (len(points) + block - 1) // block
    boxes = np.empty((count, 2, 3), dtype=np.float32)
    for k in range(count):
        for a in range(3):
            low = high = points[k * block, a]
            for i in range(k * block + 1, min(len(points), (k + 1) * block)):
                low = min(low, points[i, a])
                high = max(high, points[i, a])
            boxes[k, 0, a], boxes[k, 1, a] = low, high
    return boxes


@numba.njit(cache=True, nogil=True)
def rank_blocks(box: Points, boxes: Points, bound: Points) -> int:
    """Fill bound (K,) with squared distances of boxes (K, 2, 3) from one; gives the one centred nearest."""
    nearest, first = np.float32(np.inf), 0
    for k in range(len(boxes)):
        bound[k] = 0.0
        between = np.float32(0.0)
        for a in range(3):
            gap = max(np.float32(0.0), max(box[0, a] - boxes[k, 1, a], boxes[k, 0, a] - box[1, a]))
            bound[k] += gap * gap
            between += (box[0, a] + box[1, a] - boxes[k, 0, a] - boxes[k, 1, a]) ** 2
        if between < nearest:
            nearest, first = between, k
    return first


@numba.njit(cache=True, nogil=True, fastmath={"contract", "nsz", "nnan"})
def search_block(
    x: Points, y: Points, z: Points, model: Points, start: int, stop: int, nearest: Points, index: Indices
) -> np.float32:
    """Lower the squared distances (BLOCK,) by the model points start..stop; gives the largest left."""
    for m in range(start, stop):
        mx, my, mz = model[m, 0], model[m, 1], model[m, 2]
        for i in range(BLOCK):
            dx, dy, dz = x[i] - mx, y[i] - my, z[i] - mz
            distance = dx * dx + dy * dy + dz * dz
            closer = distance < nearest[i]
            nearest[i] = distance if closer else nearest[i]
            index[i] = np.int32(m) if closer else index[i]
    largest = np.float32(0.0)
    for i in range(BLOCK):
        largest = max(largest, nearest[i])
    return largest


@numba.njit(cache=True, nogil=True)
def closest_points(observed: Points, boxes: Points, model: Points) -> tuple[Indices, Points]:
    """For observed points (blocks * BLOCK, 3) the closest of model (M, 3): its index and squared distance.

    `boxes` are the observed blocks' bounding boxes. Of equally close model points the one met first wins;
    the order in which blocks are met depends on the arguments alone.
    """
    model_boxes = bounding_boxes(model, MODEL_BLOCK)
    index, distance = np.empty(len(observed), np.int32), np.empty(len(observed), np.float32)
    x, y, z = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    nearest, chosen = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.int32)
    bound = np.empty(len(model_boxes), np.float32)
    for b in range(len(boxes)):
        start = b * BLOCK
        for i in range(BLOCK):
            x[i], y[i], z[i] = observed[start + i, 0], observed[start + i, 1], observed[start + i, 2]
            nearest[i], chosen[i] = np.inf, 0
        first = rank_blocks(boxes[b], model_boxes, bound)
        stop = min(len(model), (first + 1) * MODEL_BLOCK)
        largest = search_block(x, y, z, model, first * MODEL_BLOCK, stop, nearest, chosen)
        for k in range(len(model_boxes)):
            if k != first and bound[k] < largest:
                stop = min(len(model), (k + 1) * MODEL_BLOCK)
                largest = search_block(x, y, z, model, k * MODEL_BLOCK, stop, nearest, chosen)
        for i in range(BLOCK):
            index[start + i], distance[start + i] = chosen[i], nearest[i]
    return index, distance
