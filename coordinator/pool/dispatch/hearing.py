"""Whether anybody answers at all."""

from __future__ import annotations

import math
from dataclasses import dataclass

from coordinator.pool.dispatch.events import Silence
from coordinator.pool.dispatch.workload import Flight

REQUEST_TIMEOUT = 30.0  # seconds; only a worker that lives and hangs takes so long
SILENT = REQUEST_TIMEOUT * 2.0 / 3.0  # a request that ends later without a result has met that timeout


@dataclass(slots=True)
class Hearing:
    """When workers have said anything."""

    answered_at: float = -math.inf  # any of them, about any request, last
    silent_at: float | None = None  # when a request ended of silence, with no answer to any since

    def heard(self, now: float) -> None:
        """Some worker has answered."""
        self.answered_at, self.silent_at = now, None

    def ended(self, flight: Flight | None, now: float) -> list[Silence]:
        """Whether a request that ended without an answer did so because nobody answers any longer."""
        if flight is None or now < flight.sent_at + SILENT or self.answered_at > flight.sent_at:
            return []
        again = self.silent_at is not None and flight.sent_at >= self.silent_at
        self.silent_at = self.silent_at or now
        return [Silence(flight.worker.name, again)]
