"""The coordinator: draws particles, has workers refine them, merges the results and records the poses."""

from __future__ import annotations

import gepf.common  # noqa: F401 must come before numba: it sets where compiled kernels are cached
