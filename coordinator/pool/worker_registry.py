"""The workers that can be asked: added and removed as they come and go, and missed when there is none."""

from __future__ import annotations

from collections.abc import Callable

from common.protocol import keys
from common.transport.bus import Bus
from common.transport.channels import Asker
from coordinator.pool.dispatch.hearing import REQUEST_TIMEOUT
from coordinator.pool.local_workers import LocalWorkers
from coordinator.pool.no_worker_timeout import NoWorkerTimeout


class WorkerRegistry:
    """Who may be asked at the moment. `report` is called with a line for people."""

    def __init__(
        self, bus: Bus, local: LocalWorkers, timeout: NoWorkerTimeout, report: Callable[[str], None]
    ) -> None:
        self.local = local
        self._bus = bus
        self._timeout = timeout
        self._report = report
        self._askers: dict[str, Asker] = {}
        self._seen: set[str] = set()

    def __len__(self) -> int:
        return len(self._askers)

    @property
    def seen(self) -> tuple[str, ...]:
        """The names of all who have ever been there."""
        return tuple(sorted(self._seen))

    def asker(self, worker: str) -> Asker:
        """How a worker that is there is asked."""
        return self._askers[worker]

    def add(self, worker: str) -> None:
        """A worker has announced itself."""
        self.local.mark_serving(worker)
        if worker in self._askers:
            return
        self._askers[worker] = self._bus.asker(keys.worker_refine(worker), REQUEST_TIMEOUT)
        self._seen.add(worker)
        self._timeout.reset()
        self._report(f"worker {worker} joined")

    def remove(self, worker: str) -> None:
        """A worker is gone."""
        asker = self._askers.pop(worker, None)
        if asker is not None:
            asker.close()
            self._report(f"worker {worker} left")

    def poll(self, now: float) -> None:
        """Start local workers that have died again; NoWorkers if nobody has been there for too long."""
        self.local.end_absent(self._askers, now)
        for line in self.local.restart_dead():
            self._report(line)
        missing = None if self._askers else self._timeout.check(now)
        if missing is not None:
            self._report(missing)
