"""The workers that a run asked for, as the port through which the tracker reaches them."""

from __future__ import annotations

import os

from coordinator.options import Pool
from coordinator.progress import Show
from coordinator.runtime import PoolOptions, ZenohRefiner


def connect_workers(pool: Pool, show: Show) -> ZenohRefiner:
    """Start local workers, one per core unless told otherwise, and let others join; a context manager."""
    return ZenohRefiner(pool_options(pool), show.say)


def pool_options(pool: Pool) -> PoolOptions:
    """What the runtime makes of a pool."""
    return PoolOptions(
        local_workers=count_cores() if pool.workers is None else pool.workers,
        listen=(pool.listen,) if pool.listen else (),
        connect=(pool.connect,) if pool.connect else (),
        security=pool.security,
        worker_timeout=pool.worker_timeout,
        deadline=pool.deadline,
    )


def count_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0))
