"""How long requests usually take, and which of those in flight take much longer."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from coordinator.pool.dispatch.workload import Flight, Worker

LATE_FACTOR = 3.0  # times the usual time from request to result
LATE_LEAST = 0.05  # seconds
SMOOTHING = 0.2  # of the usual time


@dataclass(slots=True)
class Lateness:
    """What is usual lately."""

    usual_seconds: float | None = None  # from request to result, for each particle of a lane

    def learn(self, flight: Flight, at: float) -> None:
        """A request was answered at a time, and its worker was busy with it since it was free for it."""
        worker = flight.worker
        seconds = (at - flight.sent_at) / flight.load
        usual = seconds if self.usual_seconds is None else self.usual_seconds
        self.usual_seconds = usual + SMOOTHING * (seconds - usual)
        took = at - max(flight.sent_at, worker.answered_at)
        worker.paces.append(took / flight.load)
        worker.answered_at = at

    def may_be(self, flights: Iterable[Flight], now: float) -> bool:
        """Whether any may be late; the first of all that are in flight is the oldest."""
        oldest = next(iter(flights), None)
        return oldest is not None and now >= oldest.sent_at + LATE_LEAST

    def latest(self, flights: Iterable[Flight], worker: Worker, now: float) -> Flight | None:
        """The oldest late one whose batch is with nobody else, and was not refused by a worker."""
        by_batch: dict[int, list[Flight]] = {}
        for flight in flights:
            by_batch.setdefault(id(flight.batch), []).append(flight)
        late = [
            alone[0]
            for alone in by_batch.values()
            if len(alone) == 1 and self.is_late(alone[0], now) and not alone[0].batch.is_refused_by(worker)
        ]
        return min(late, key=lambda flight: flight.sent_at, default=None)

    def is_late(self, flight: Flight, now: float) -> bool:
        """Whether a request takes much longer than usual for what it asks for."""
        if self.usual_seconds is None:
            return False
        patience = max(LATE_LEAST, LATE_FACTOR * self.usual_seconds * flight.load)
        return now >= flight.sent_at + patience
