"""Who refines for a tracker of the library: this process, a local worker, or workers elsewhere."""

from __future__ import annotations

import logging
from contextlib import ExitStack

from common.errors import InputError
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.tracking.refiner import Refiner
from gepf.direct import DirectRefiner
from gepf.security import secure

log = logging.getLogger("gepf")

Workers = int | str | Pool


def open_refiner(workers: Workers | None, stack: ExitStack) -> Refiner:
    """Who refines, until the stack is closed."""
    if workers is None:
        return DirectRefiner()
    return stack.enter_context(ZenohRefiner(choose_workers(workers), log.info))


def choose_workers(workers: Workers) -> Pool:
    """A pool from its short forms; InputError for one that nobody could join."""
    match workers:
        case Pool():
            return workers
        case str():
            return Pool(0, connect=workers, security=secure(None, workers))
        case _ if workers < 1:
            raise InputError(f"workers={workers} would refine nothing; give None, 1 or more, or a Pool")
        case _:
            return Pool(workers)
