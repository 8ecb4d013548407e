"""How commands reach the workers of a run."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from coordinator.commands.progress import Show
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner

Connect = Callable[[Pool, Show], AbstractContextManager[ZenohRefiner]]
"""Opens a pool until the end of the context."""


def connect_workers(pool: Pool, show: Show) -> ZenohRefiner:
    """Start a local worker, with one lane per core by default, and let others join."""
    return ZenohRefiner(pool, show.say)
