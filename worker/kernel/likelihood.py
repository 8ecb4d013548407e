"""How well a pose explains a frame (step 5).

The paper says only "calculated from the residual error". Here the log likelihood of a pose is

    -1/2 (mean over observed points of rho(d_i) + w_f mean over visible model points of rho(f_v)) / T

with d_i the distance of an observed point from its closest visible model point and f_v the distance by
which a model point lies where the camera saw nothing, both in units of the lateral noise, and rho the
squared distance, or what a robust kernel makes of it. The mean, not the sum, because neighbouring points
err together: a sum over ten thousand of them would let no second hypothesis live.
"""

from __future__ import annotations

import numba


@numba.njit(cache=True, nogil=True, inline="always")
def robust_weight(squared: float, scale_squared: float) -> float:
    """Weight of a residual under Geman and McClure's kernel; 1 without a scale."""
    if scale_squared <= 0.0:
        return 1.0
    ratio = scale_squared / (scale_squared + squared)
    return ratio * ratio


@numba.njit(cache=True, nogil=True, inline="always")
def robust_cost(squared: float, scale_squared: float) -> float:
    """Cost of a residual under Geman and McClure's kernel; the square without a scale."""
    if scale_squared <= 0.0:
        return squared
    return scale_squared * squared / (scale_squared + squared)
