"""The interface of commands to the workers of a run."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from coordinator.commands.progress import Show
from coordinator.pool.options import Pool, PoolStatistics
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.results.live_results import Sender
from coordinator.tracking.refiner import Refiner


class Workers(Refiner, Protocol):
    """A refiner with statistics, on a bus where others publish and listen."""

    @property
    def statistics(self) -> PoolStatistics:
        """Workers and batches so far."""
        ...

    @property
    def run(self) -> str:
        """The name of the run on the bus."""
        ...

    def wait_for(self, lanes: int) -> None:
        """Wait for workers with this number of lanes."""
        ...

    def listen(self, key: str, on_message: Callable[[bytes], None]) -> None:
        """Call `on_message(payload)` for each message on a key."""
        ...

    def speak(self, key: str) -> Sender:
        """A publisher for a key."""
        ...


Connect = Callable[[Pool, Show], AbstractContextManager[Workers]]
"""Opens a pool until the end of the context."""


def connect_workers(pool: Pool, show: Show) -> ZenohRefiner:
    """Start a local worker, with one lane per core by default, and let others join."""
    return ZenohRefiner(pool, show.say)
