"""The workers that a run asked for, as the port through which the tracker reaches them."""

from __future__ import annotations

from coordinator.commands.progress import Show
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner


def connect_workers(pool: Pool, show: Show) -> ZenohRefiner:
    """Start local workers, one per core unless told otherwise, and let others join; a context manager."""
    return ZenohRefiner(pool, show.say)
