"""The workers of a run, as the port through which commands reach them."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from coordinator.commands.progress import Show
from coordinator.pool.options import Pool, PoolStatistics
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.results.live_results import Outlet
from coordinator.tracking.refiner import Refiner


class Workers(Refiner, Protocol):
    """A refiner that reports who did the work, on a bus where others publish and listen."""

    @property
    def statistics(self) -> PoolStatistics:
        """Workers and batches so far."""
        ...

    def listen(self, key: str, on_message: Callable[[bytes], None]) -> None:
        """Have `on_message(payload)` called for what is published on a key."""
        ...

    def speak(self, key: str) -> Outlet:
        """Where to put what others are to hear on a key."""
        ...


Connect = Callable[[Pool, Show], AbstractContextManager[Workers]]
"""Opens a pool for as long as the context lasts."""


def connect_workers(pool: Pool, show: Show) -> ZenohRefiner:
    """Start a local worker, with a lane per core unless it is given otherwise, and let others join."""
    return ZenohRefiner(pool, show.say)
