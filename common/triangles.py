"""Lower triangles of square matrices, row after row, as they travel."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray


def triangle_size(side: int) -> int:
    """How many entries of a square matrix of a side are on its diagonal or below."""
    return side * (side + 1) // 2


def lower_triangular(triangles: NDArray[np.float32], side: int) -> NDArray[np.float64]:
    """Matrices (N, D, D), zero above the diagonal, from their lower triangles (N, D (D + 1) / 2)."""
    matrices = np.zeros((len(triangles), side * side))
    matrices[:, places(side)] = triangles
    return matrices.reshape(len(triangles), side, side)


@lru_cache(maxsize=16)
def row_starts(side: int) -> NDArray[np.int64]:
    """Where each row of a lower triangle begins."""
    starts: NDArray[np.int64] = np.cumsum(np.arange(side))
    return starts


@lru_cache(maxsize=16)
def places(side: int) -> NDArray[np.int64]:
    """Where the entries of a lower triangle stand in a square matrix that is written as one row."""
    return np.flatnonzero(np.tri(side, dtype=np.bool_))
