"""Types of arrays, by what their numbers are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]
Points = NDArray[np.float32]
Numbers = NDArray[np.uint32]
