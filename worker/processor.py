"""The processor for which kernels are compiled."""

from __future__ import annotations

import hashlib

from gepf.common.compiling import numba


def processor_name() -> str:
    """Name and hash of the features of the processor that kernels are compiled for; if equal, so are results.

    NUMBA_CPU_NAME and NUMBA_CPU_FEATURES change both.
    """
    _, name, features = numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
    return f"{name}-{hashlib.sha256(features.encode()).hexdigest()[:6]}" if features else str(name)
