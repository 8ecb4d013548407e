"""One tracker: draws particles, has workers refine them, merges them and records the poses."""

from __future__ import annotations

import gepf.common  # noqa: F401 before numba: it says where compiled kernels are kept
