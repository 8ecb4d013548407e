"""Who refines what: events in, instructions out; no clock, no socket.

A job is split into one batch of particles for each worker, larger ones for those with more lanes and for
faster ones; or, where what is refined by a deadline counts, into several of them. A worker has at most
`WINDOW` of them in flight. A batch that ends without a result is split among the workers that are left. When
nothing waits, batches that take long are sent again to idle workers. The first result of a batch counts,
later ones are ignored. A worker that fails again and again rests for a while; a batch that every worker
refuses fails the job.

Every request has a ticket. It stays in flight, and in its worker's window, until it is answered or over,
even when its job is done: a worker that is still busy with it cannot do other work.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median

from coordinator.pool.dispatch.batches import split, split_in_rounds
from coordinator.pool.dispatch.events import (
    Accept,
    Done,
    Ended,
    Event,
    Fail,
    Instruction,
    JobStarted,
    LanesCounted,
    Refused,
    Replied,
    Send,
    Silence,
    Ticked,
    Unavailable,
    WorkerJoined,
    WorkerLeft,
)
from coordinator.pool.dispatch.workload import (
    PACES,
    WINDOW,
    Batch,
    Flight,
    Worker,
    clip,
    least_busy,
    rank,
    strike,
)

LATE_FACTOR = 3.0  # times the usual time from request to result
LATE_LEAST = 0.05  # seconds
SMOOTHING = 0.2  # of the usual time
SHORTEST = 1e-6  # seconds a particle
PAUSE = 0.1  # seconds after a request that nothing came of: the worker may just have gone, or come
REFUSALS_LEAST = 3  # of a batch, before it fails the job
SILENT = 20.0  # seconds; a request that ends later without a result has met the bus's own timeout


@dataclass(slots=True)
class Counts:
    """How often things happened."""

    batches_sent: int = 0
    batches_sent_again: int = 0
    batches_refused: int = 0


@dataclass(slots=True)
class Scheduler:
    """The state between two events."""

    workers: dict[str, Worker] = field(default_factory=dict)
    flights: dict[int, Flight] = field(default_factory=dict)  # by ticket
    batches: list[Batch] = field(default_factory=list)  # of the job; none when there is no job
    counts: Counts = field(default_factory=Counts)
    lanes: dict[str, int] = field(default_factory=dict)  # by worker, there or not
    usual_seconds: float | None = None  # from request to result, for each particle of a lane
    next_ticket: int = 0
    may_wait: bool = False  # whether there may be batches that wait; to look costs time with many
    answered_at: float = -math.inf  # when any worker has said anything about any request last
    silent_at: float | None = None  # when a request ended of silence, with no answer to any since

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """What is to be done about an event at time `now`, seconds from any origin."""
        match event:
            case JobStarted(particles, in_parts, spare):
                ranges = self._shares(particles - spare, self._in_turn(now), in_parts=in_parts)
                ranges += [(particles - spare, particles)] if spare else []
                self.batches = [Batch(*ends) for ends in ranges]
                self.may_wait = True
                outcome: list[Instruction] = [] if self.batches else [Done()]
            case WorkerJoined(name):
                self.workers.setdefault(name, Worker(name, self.lanes.get(name, 1)))
                outcome = []
            case LanesCounted(name, lanes):
                self._count_lanes(name, lanes)
                outcome = []
            case WorkerLeft(name):
                self._forget(name)
                outcome = []
            case Replied(ticket, at):
                self._hear(now)
                outcome = self._accept(ticket, now if at is None else at)
            case Refused(ticket, reason):
                self._hear(now)
                outcome = self._refuse(ticket, reason, now)
            case Unavailable(ticket):
                self._hear(now)
                self._give_up(ticket, now)
                outcome = []
            case Ended(ticket):
                ended = self._give_up(ticket, now)
                return [*self._assign(now), *self._listen(ended, now)]
            case Ticked():
                outcome = []
        return outcome + self._assign(now)

    def is_current(self, ticket: int) -> bool:
        """Whether a result of this ticket would be of use."""
        flight = self.flights.get(ticket)
        return flight is not None and not flight.batch.done and flight.batch in self.batches

    def waiting(self) -> list[Batch]:
        """Batches that have no result and are not in flight, in order."""
        flying = {id(flight.batch) for flight in self.flights.values()}
        return [batch for batch in self.batches if not batch.done and id(batch) not in flying]

    def _count_lanes(self, name: str, lanes: int) -> None:
        self.lanes[name] = lanes
        if name in self.workers:
            self.workers[name].lanes = lanes

    def _forget(self, name: str) -> None:
        worker = self.workers.pop(name, None)
        for ticket in worker.flights if worker else ():
            self.flights.pop(ticket).batch.came_back = True
        self.may_wait = True

    def _land(self, ticket: int) -> Flight | None:
        """Take a ticket out of flight; None if it is over already."""
        flight = self.flights.pop(ticket, None)
        if flight is not None:
            del flight.worker.flights[ticket]
        return flight

    def _accept(self, ticket: int, at: float) -> list[Instruction]:
        current = self.is_current(ticket)
        flight = self._land(ticket)
        if flight is None:
            return []
        flight.worker.strikes = flight.worker.rests = 0
        self._learn(flight, at)
        if not current:
            return []
        flight.batch.done = True
        accepted = Accept(ticket, flight.batch.start)
        if not all(batch.done for batch in self.batches):
            return [accepted]
        self.batches = []
        return [accepted, Done()]

    def _learn(self, flight: Flight, at: float) -> None:
        worker = flight.worker
        seconds = (at - flight.sent_at) / flight.load
        usual = seconds if self.usual_seconds is None else self.usual_seconds
        self.usual_seconds = usual + SMOOTHING * (seconds - usual)
        took = at - max(flight.sent_at, worker.answered_at)
        worker.paces.append(took / flight.load)
        worker.answered_at = at

    def _in_turn(self, now: float) -> list[Worker]:
        """All workers in the order in which they get batches: those that rest come last."""
        ready = [worker for *_, worker in sorted(rank(self.workers.values(), now))]
        return ready + [worker for worker in self.workers.values() if worker.rests_until > now]

    def _speeds(self, workers: Sequence[Worker]) -> Sequence[float]:
        """How fast each worker is; a usual lane is 1, and so is a lane of which little is known."""
        paces = [median(w.paces) if len(w.paces) == PACES else None for w in workers]
        usual = max(SHORTEST, median([pace for pace in paces if pace is not None] or [SHORTEST]))
        return [
            worker.lanes * (1.0 if pace is None else clip(usual / max(SHORTEST, pace)))
            for worker, pace in zip(workers, paces, strict=True)
        ]

    def _shares(
        self, particles: int, workers: Sequence[Worker], *, in_parts: bool = False
    ) -> list[tuple[int, int]]:
        """Ranges of particles for these workers."""
        speeds = self._speeds(workers)
        if workers and not in_parts:
            return split_in_rounds(particles, speeds, [worker.lanes for worker in workers])
        return split(particles, speeds, in_parts=in_parts)

    def _refuse(self, ticket: int, reason: str, now: float) -> list[Instruction]:
        current = self.is_current(ticket)
        flight = self._land(ticket)
        if flight is None:
            return []
        self.may_wait = True
        self.counts.batches_refused += 1
        strike(flight.worker, now)
        flight.batch.refusals.append((flight.worker.name, reason))
        if not current or not self._is_refused_by_all(flight.batch):
            return []
        self.batches = []
        reasons = dict.fromkeys(reason for _, reason in flight.batch.refusals)
        return [Fail("; ".join(reasons))]

    def _is_refused_by_all(self, batch: Batch) -> bool:
        refusers = {worker for worker, _ in batch.refusals}
        return len(batch.refusals) >= REFUSALS_LEAST and refusers >= self.workers.keys()

    def _give_up(self, ticket: int, now: float) -> Flight | None:
        flight = self._land(ticket)
        if flight is not None:
            self.may_wait = True
            flight.batch.came_back = True
            strike(flight.worker, now)
            flight.worker.rests_until = max(flight.worker.rests_until, now + PAUSE)
        return flight

    def _hear(self, now: float) -> None:
        self.answered_at, self.silent_at = now, None

    def _listen(self, ended: Flight | None, now: float) -> list[Instruction]:
        """Whether a request ended because nobody at all answers any longer."""
        if ended is None or now < ended.sent_at + SILENT or self.answered_at > ended.sent_at:
            return []
        again = self.silent_at is not None and ended.sent_at >= self.silent_at
        self.silent_at = self.silent_at or now
        return [Silence(ended.worker.name, again)]

    def _assign(self, now: float) -> list[Instruction]:
        sends = self._hand_out(now) if self.may_wait else []
        return [*sends, *self._assign_again(now)]

    def _hand_out(self, now: float) -> list[Instruction]:
        """Send what waits to who is free."""
        sends: list[Instruction] = []
        self._split_what_came_back(now)
        waiting, ranks = self.waiting(), rank(self.workers.values(), now)
        for batch in waiting:
            worker = self._pick(batch, now) if batch.refusals else least_busy(ranks)
            if worker is not None:
                sends.append(self._send(batch, worker, now))
        self.may_wait = len(sends) < len(waiting)
        return sends

    def _split_what_came_back(self, now: float) -> None:
        """Split batches that ended without a result among the workers, lest one does it all alone."""
        workers = [worker for *_, worker in sorted(rank(self.workers.values(), now))]
        for batch in [batch for batch in self.waiting() if batch.came_back and not batch.refusals]:
            parts = [
                Batch(batch.start + start, batch.start + stop, sent=batch.sent)
                for start, stop in self._shares(batch.stop - batch.start, workers)
            ]
            place = self.batches.index(batch)
            self.batches[place : place + 1] = parts

    def _pick(self, batch: Batch, now: float) -> Worker | None:
        """The least busy worker for a batch that was refused: one that refused it only if all have."""
        refusers = {worker for worker, _ in batch.refusals}
        willing = [w for w in self.workers.values() if w.name not in refusers] or self.workers.values()
        free = [w for w in willing if len(w.flights) < WINDOW and w.rests_until <= now]
        return min(free, key=lambda worker: len(worker.flights), default=None)

    def _assign_again(self, now: float) -> list[Instruction]:
        """Send what takes long again to workers that have nothing to do."""
        sends: list[Instruction] = []
        if not self.flights or now < next(iter(self.flights.values())).sent_at + LATE_LEAST:
            return sends  # the first of all flights is the oldest
        for worker in self.workers.values():
            late = None if worker.flights or worker.rests_until > now else self._latest(worker, now)
            if late is not None:
                sends.append(self._send(late, worker, now))
        return sends

    def _latest(self, worker: Worker, now: float) -> Batch | None:
        """The batch that has been in flight for longest, and longer than usual, and only once."""
        flying: dict[int, list[Flight]] = {}
        for flight in self.flights.values():
            flying.setdefault(id(flight.batch), []).append(flight)
        late = [
            flights[0]
            for flights in flying.values()
            if len(flights) == 1
            and self._is_late(flights[0], now)
            and flights[0].batch in self.batches
            and not flights[0].batch.done
            and worker.name not in {name for name, _ in flights[0].batch.refusals}
        ]
        return min(late, key=lambda flight: flight.sent_at).batch if late else None

    def _is_late(self, flight: Flight, now: float) -> bool:
        """Whether a request takes much longer than usual for what it asks for."""
        if self.usual_seconds is None:
            return False
        patience = max(LATE_LEAST, LATE_FACTOR * self.usual_seconds * flight.load)
        return now >= flight.sent_at + patience

    def _send(self, batch: Batch, worker: Worker, now: float) -> Instruction:
        ticket, self.next_ticket = self.next_ticket, self.next_ticket + 1
        self.flights[ticket] = worker.flights[ticket] = Flight(worker, batch, now)
        self.counts.batches_sent += 1
        self.counts.batches_sent_again += batch.sent > 0
        batch.sent += 1
        return Send(ticket, worker.name, batch.start, batch.stop)
