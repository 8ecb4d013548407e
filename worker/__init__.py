"""Refines batches of particles by articulated ICP, without state between requests or randomness."""

from __future__ import annotations

import gepf.common  # noqa: F401 before numba: it says where compiled kernels are kept
