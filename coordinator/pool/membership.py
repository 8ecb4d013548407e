"""The workers that are there: how each is asked, and what to tell of those who come, go or are missing."""

from __future__ import annotations

from collections.abc import Callable

from common.protocol import keys
from common.transport.bus import Asker, Bus
from coordinator.pool.local_workers import LocalWorkers
from coordinator.pool.no_worker_timeout import Absence

REQUEST_TIMEOUT = 30.0  # seconds; only a worker that lives and hangs takes so long


class Members:
    """Who may be asked at the moment. `tell` is called with a line for people."""

    def __init__(self, bus: Bus, local: LocalWorkers, absence: Absence, tell: Callable[[str], None]) -> None:
        self.local = local
        self._bus = bus
        self._absence = absence
        self._tell = tell
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

    def welcome(self, worker: str) -> None:
        """A worker has announced itself."""
        self.local.mark_serving(worker)
        if worker in self._askers:
            return
        self._askers[worker] = self._bus.asker(keys.worker_refine(worker), REQUEST_TIMEOUT)
        self._seen.add(worker)
        self._absence.end()
        self._tell(f"worker {worker} joined")

    def dismiss(self, worker: str) -> None:
        """A worker is gone."""
        asker = self._askers.pop(worker, None)
        if asker is not None:
            asker.close()
            self._tell(f"worker {worker} left")

    def look(self, now: float) -> None:
        """Start those of our own that have died; NoWorkers if nobody has been there for too long."""
        for line in self.local.restart_dead():
            self._tell(line)
        missing = None if self._askers else self._absence.look(now)
        if missing is not None:
            self._tell(missing)
