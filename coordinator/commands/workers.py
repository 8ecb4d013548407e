"""The workers of a run, as the ports through which commands reach them."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol, TypeVar

from coordinator.commands.console.interrupts import INTERRUPTS
from coordinator.commands.console.progress import Show
from coordinator.pool.options import Pool
from coordinator.pool.statistics import PoolStatistics
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.tracking.refiner import Refiner


class PooledRefiner(Refiner, Protocol):
    """A refiner that reports who did the work."""

    @property
    def statistics(self) -> PoolStatistics:
        """Workers and batches so far."""
        ...


class ListeningRefiner(PooledRefiner, Protocol):
    """A refiner on a bus where others publish."""

    def listen(self, key: str, on_message: Callable[[bytes], None]) -> None:
        """Have `on_message(payload)` called for what is published on a key."""
        ...


R = TypeVar("R", bound=Refiner)

Connect = Callable[[Pool, Show], AbstractContextManager[R]]
"""Opens a pool for as long as the context lasts."""


def connect_workers(pool: Pool, show: Show) -> ZenohRefiner:
    """Start a local worker, with a lane per core unless it is given otherwise, and let others join."""
    return ZenohRefiner(pool, show.say)


def end_as_interrupted() -> None:
    """Let SIGTERM end a run as Ctrl-C does, so that its frames are kept."""
    signal.signal(signal.SIGTERM, INTERRUPTS.note)
