"""Arrays as compiled kernels take them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def contiguous(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A copy in C order, of float64: kernels are compiled for one memory layout."""
    return np.array(values, dtype=np.float64, order="C")
