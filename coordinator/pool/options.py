"""The options of a pool of workers, and its statistics."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field

from gepf.common.cores import usable_cores
from gepf.common.offer import CPU
from gepf.common.transport.session import Security

WORKER_COMMAND = (sys.executable, "-P", "-m", "gepf.worker.cli")


@dataclass(frozen=True, slots=True)
class Pool:
    """The workers of a run: a local one, and others that connect to it or to a router."""

    workers: int | None = None  #: lanes of the local worker; None for one per core, 0 for no local worker
    listen: str | None = None  #: endpoint at which others may join
    connect: str | None = None  #: endpoint of a router with other workers
    security: Security | None = None
    worker_timeout: float | None = None  #: seconds without any worker until the run ends; None: never
    kind: str = CPU  #: of the kernel of all workers that are used
    run: str | None = None  #: name; None for a random one
    worker_command: tuple[str, ...] = WORKER_COMMAND
    shared_at: str | None = None  #: endpoint of this pool, if several runs share it
    insecure: bool = False  #: in the library: links to other hosts may be unencrypted

    @property
    def lanes(self) -> int:
        """Lanes of the local worker; 0 for none."""
        return usable_cores() if self.workers is None else self.workers

    @property
    def listen_endpoints(self) -> tuple[str, ...]:
        """Endpoints at which others may join."""
        return (self.listen,) if self.listen else ()

    @property
    def connect_endpoints(self) -> tuple[str, ...]:
        """Endpoints to which this process connects."""
        return (self.connect,) if self.connect else ()


@dataclass(slots=True)
class PoolStatistics:
    """The workers of the run and their processors, and counts of batches, invalid replies and restarts."""

    workers_seen: tuple[str, ...] = ()
    counts: dict[str, int] = field(default_factory=dict)
    processors: tuple[str, ...] = ()

    def after(self, earlier: PoolStatistics) -> PoolStatistics:
        """The statistics of a whole run: `earlier` ones plus these, which are of the part after them."""
        counts = Counter(earlier.counts)
        counts.update(self.counts)
        return PoolStatistics(
            tuple(sorted({*earlier.workers_seen, *self.workers_seen})),
            dict(counts),
            tuple(sorted({*earlier.processors, *self.processors})),
        )
