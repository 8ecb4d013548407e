"""One look in compiled code at the numbers of a reply, which are right but for broken or hostile workers.

What is wrong with those that are not is for `checks` to say.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from common.bounds import LARGEST_DEVIATION, LARGEST_LOG_LIKELIHOOD, LARGEST_POSE
from common.compiling import numba

Array = NDArray[np.float64]


@numba.njit(cache=True, nogil=True)
def are_refined(poses: Array, log_likelihood: Array, residual: Array) -> bool:
    """Whether these (N, D), (N,) and (N,) can be refined particles."""
    fine = True
    for n in range(len(poses)):
        for j in range(poses.shape[1]):
            fine &= abs(poses[n, j]) <= LARGEST_POSE  # not for what is no number, as all that follows
        likely = log_likelihood[n]
        fine &= abs(likely) <= LARGEST_LOG_LIKELIHOOD or likely == -np.inf
        fine &= residual[n] >= 0.0
    return fine


@numba.njit(cache=True, nogil=True)
def are_roots(roots: NDArray[np.float32], dofs: int) -> bool:
    """Whether these (N, D (D + 1) / 2) are factors of covariances, none of them too wide."""
    fine = True
    for n in range(len(roots)):
        place = 0
        for i in range(dofs):
            squares = 0.0
            for j in range(i + 1):
                squares += np.float64(roots[n, place + j]) ** 2
            fine &= roots[n, place + i] > 0.0 and squares <= LARGEST_DEVIATION**2
            place += i + 1
    return fine
