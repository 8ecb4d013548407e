"""The Geman-McClure kernel: residuals far above its scale have nearly constant cost.

Its parameter is the inverse square of the scale; with 0 the kernel is the identity. So it needs no branches.
"""

from __future__ import annotations

from gepf.common.compiling import numba


@numba.njit(cache=True, nogil=True, inline="always")
def robust_weight(squared: float, per_scale_squared: float) -> float:
    """Weight of a residual, given its square."""
    ratio = 1.0 / (1.0 + per_scale_squared * squared)
    return ratio * ratio


@numba.njit(cache=True, nogil=True, inline="always")
def robust_cost(squared: float, per_scale_squared: float) -> float:
    """Cost of a residual, given its square."""
    return squared / (1.0 + per_scale_squared * squared)
