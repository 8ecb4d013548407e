"""The Geman-McClure kernel: residuals far above its scale have nearly constant cost. No scale is none."""

from __future__ import annotations

from gepf.common.compiling import numba


@numba.njit(cache=True, nogil=True, inline="always")
def robust_weight(squared: float, scale_squared: float) -> float:
    """Weight of a residual; 1 without a scale."""
    if scale_squared <= 0.0:
        return 1.0
    ratio = scale_squared / (scale_squared + squared)
    return ratio * ratio


@numba.njit(cache=True, nogil=True, inline="always")
def robust_cost(squared: float, scale_squared: float) -> float:
    """Cost of a residual; the square without a scale."""
    if scale_squared <= 0.0:
        return squared
    return scale_squared * squared / (scale_squared + squared)
