"""One pool for several runs at once: a router within this process, and the local worker behind it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from common.transport.endpoints import LOCAL
from common.transport.opening import open_router
from coordinator.pool.local_workers import LocalWorkers, private_folder
from coordinator.pool.options import Pool

WORKER = "shared-0"


@dataclass(frozen=True, slots=True, eq=False)
class SharedPool:
    """Where runs of this host reach the workers that they share."""

    endpoint: str
    workers: LocalWorkers
    asked: Pool

    def of_a_run(self) -> Pool:
        """The pool as one of the runs sees it: without workers of its own, through a socket of this host."""
        through = replace(self.asked, connect=self.endpoint, listen=None, security=None)
        return replace(through, workers=0, asked=self.asked)


@contextmanager
def shared_pool(pool: Pool) -> Iterator[SharedPool]:
    """Start the local worker of `pool`, and let others join as it says, for as long as the context lasts."""
    with private_folder() as name:
        folder = Path(name)
        local = f"{LOCAL}/{folder / 'bus'}"
        with open_router([local, *pool.listen_endpoints], pool.connect_endpoints, pool.security):
            names = [WORKER] if pool.lanes else []
            workers = LocalWorkers(names, local, folder, (*pool.worker_command, "--lanes", str(pool.lanes)))
            try:
                yield SharedPool(local, workers, pool)
            finally:
                workers.stop()
