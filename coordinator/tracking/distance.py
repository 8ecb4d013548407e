"""How far two postures are apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def farthest_joint(one: Array, other: Array) -> Array:
    """Between the joints (..., J, 3) of two postures the greatest distance (...), metres."""
    farthest: Array = np.linalg.norm(one - other, axis=-1).max(axis=-1)
    return farthest
