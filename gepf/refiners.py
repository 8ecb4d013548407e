"""Who refines for a tracker of the library: this process, a local worker, or workers elsewhere."""

from __future__ import annotations

import logging
from contextlib import ExitStack
from dataclasses import replace

from common.errors import InputError
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from coordinator.security.access import TlsFiles
from coordinator.tracking.refiner import Refiner
from gepf.direct import DirectRefiner
from gepf.security import said_in_python, secure

log = logging.getLogger("gepf")

Workers = int | str | Pool


def open_refiner(workers: Workers | None, tls: TlsFiles | None, stack: ExitStack) -> Refiner:
    """Who refines, until the stack is closed."""
    if workers is None:
        return DirectRefiner()
    with said_in_python():
        return stack.enter_context(ZenohRefiner(choose_workers(workers, tls), log.info))


def choose_workers(workers: Workers, tls: TlsFiles | None = None) -> Pool:
    """A pool from its short forms, with certificates; InputError for one that nobody could join."""
    match workers:
        case Pool() if tls is None:
            return workers
        case Pool():
            return replace(workers, security=secure(workers.listen, workers.connect, tls))
        case str():
            with said_in_python({"connect=": "workers="}):
                return Pool(0, connect=workers, security=secure(None, workers, tls))
        case _ if workers < 1:
            raise InputError(f"workers={workers} would refine nothing; give None, 1 or more, or a Pool")
        case _:
            return Pool(workers)
