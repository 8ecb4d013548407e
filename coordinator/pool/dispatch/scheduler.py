"""Who refines what: events in, instructions out; no clock, no socket.

The particles are split into one batch for each worker, larger ones for those with more lanes; or, where what
is refined by a deadline counts, into several of them. A worker has at most
`MAX_IN_FLIGHT` of them in flight. A batch that ends without a result is split among the workers that are
left. When nothing waits, stragglers are sent again to idle workers. The first result of a batch counts, later
ones are ignored. A worker that fails rests; a batch that every worker refuses fails the refinement.

Every request has a ticket. It stays in flight until it is answered or over, even when its refinement is done:
a worker that is still busy with it cannot do other work.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from statistics import median

from coordinator.pool.dispatch.batches import (
    Batch,
    InFlight,
    Worker,
    batches_of,
    split,
)
from coordinator.pool.dispatch.events import (
    Accept,
    Done,
    Ended,
    Event,
    Fail,
    Instruction,
    LanesCounted,
    NoAnswer,
    Refused,
    Replied,
    Send,
    Started,
    Unavailable,
    WorkerJoined,
    WorkerLeft,
)

MAX_IN_FLIGHT = 2  # requests at one worker: it finds the next one there when it is done with one
TICK_S = 0.1  # between looks at the clock; nothing is a straggler sooner
LATE_FACTOR = 3.0  # times the worker's pace, from which on a request is a straggler
REST_S = 0.5  # of a worker that failed: it may just have gone, or come
REFUSALS_LEAST = 3  # of a batch, before it fails the refinement
REQUEST_TIMEOUT_S = 30.0  # only a worker that lives and hangs takes so long


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
    in_flight: dict[int, InFlight] = field(default_factory=dict)  # by ticket, so the oldest is first
    batches: list[Batch] = field(default_factory=list)  # none when nothing is to be refined
    counts: Counts = field(default_factory=Counts)
    lanes: dict[str, int] = field(default_factory=dict)  # by worker, there or not
    next_ticket: int = 0
    answered_at: float = -math.inf  # when a worker said anything, last
    unanswered_at: float | None = None  # when a request met the timeout, with no answer to any since

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """What is to be done about an event at time `now`, seconds from any origin."""
        outcome: list[Instruction] = []
        ended: InFlight | None = None
        if isinstance(event, Replied | Refused | Unavailable):
            self.answered_at, self.unanswered_at = now, None
        match event:
            case Started(particles, by_deadline, largest_batch):
                workers = sorted(self.workers.values(), key=lambda w: (w.rests_until > now, len(w.in_flight)))
                self.batches = batches_of(particles, workers, largest_batch, by_deadline=by_deadline)
                outcome = [] if self.batches else [Done()]
            case Replied(ticket):
                outcome = self._accept(ticket, now)
            case Refused(ticket, reason):
                outcome = self._refuse(ticket, reason, now)
            case Unavailable(ticket) | Ended(ticket):
                ended = self._land(ticket)
                if ended is not None:
                    ended.worker.rests_until = now + REST_S
            case WorkerJoined() | LanesCounted() | WorkerLeft():
                self._update_workers(event)
        outcome += [*self._assign(now), *self._assign_stragglers(now)]
        if isinstance(event, Ended) and ended is not None:
            outcome += self._check_answers(ended, now)
        return outcome

    def is_current(self, ticket: int) -> bool:
        """Whether a result of this ticket would be of use."""
        flight = self.in_flight.get(ticket)
        return flight is not None and not flight.batch.done and flight.batch in self.batches

    def _update_workers(self, event: WorkerJoined | LanesCounted | WorkerLeft) -> None:
        name = event.worker
        match event:
            case WorkerJoined():
                self.workers.setdefault(name, Worker(name, self.lanes.get(name, 1)))
            case LanesCounted(_, lanes):
                self.lanes[name] = lanes
                if name in self.workers:
                    self.workers[name].lanes = lanes
            case WorkerLeft() if name in self.workers:
                for ticket in [*self.workers[name].in_flight]:
                    self._land(ticket)
                del self.workers[name]

    def _land(self, ticket: int, *, came_back: bool = True) -> InFlight | None:
        """Take a ticket out of flight; None if it is over already."""
        flight = self.in_flight.pop(ticket, None)
        if flight is not None:
            del flight.worker.in_flight[ticket]
            flight.batch.in_flight -= 1
            flight.batch.came_back |= came_back
        return flight

    def _accept(self, ticket: int, now: float) -> list[Instruction]:
        current = self.is_current(ticket)
        flight = self._land(ticket, came_back=False)
        if flight is None:
            return []
        flight.worker.pace = (now - flight.sent_at) / flight.load
        if not current:
            return []
        flight.batch.done = True
        accepted = Accept(ticket, flight.batch.start)
        if not all(batch.done for batch in self.batches):
            return [accepted]
        self.batches = []
        return [accepted, Done()]

    def _refuse(self, ticket: int, reason: str, now: float) -> list[Instruction]:
        current = self.is_current(ticket)
        flight = self._land(ticket, came_back=False)
        if flight is None:
            return []
        self.counts.batches_refused += 1
        flight.worker.rests_until = now + REST_S
        refusals = flight.batch.refusals
        refusals.append((flight.worker.name, reason))
        by_all = {worker for worker, _ in refusals} >= self.workers.keys()
        if not current or len(refusals) < REFUSALS_LEAST or not by_all:
            return []
        self.batches = []
        return [Fail("; ".join(dict.fromkeys(reason for _, reason in refusals)))]

    def _assign(self, now: float) -> list[Instruction]:
        """Send what waits to the workers that are free, the least busy first."""
        if not any(batch.waits for batch in self.batches):
            return []
        awake = [worker for worker in self.workers.values() if worker.rests_until <= now]
        free = [
            (busy, place, worker)
            for place, worker in enumerate(awake)
            for busy in range(len(worker.in_flight), MAX_IN_FLIGHT)
        ]
        slots = [worker for *_, worker in sorted(free)]
        self._split_what_came_back(awake)
        sends: list[Instruction] = []
        for batch in [batch for batch in self.batches if batch.waits]:
            refusers = {name for name, _ in batch.refusals}
            again = refusers >= self.workers.keys()
            place = next((n for n, w in enumerate(slots) if again or w.name not in refusers), None)
            if place is not None:
                sends.append(self._send(batch, slots.pop(place), now))
        return sends

    def _split_what_came_back(self, awake: list[Worker]) -> None:
        """Split batches that ended without a result among the workers, or one would do it all alone."""
        workers = sorted(awake, key=lambda worker: len(worker.in_flight))
        for batch in [batch for batch in self.batches if batch.waits and batch.came_back]:
            if workers and not batch.refusals:
                ranges = split(batch.stop - batch.start, [worker.lanes for worker in workers])
                parts = [Batch(batch.start + a, batch.start + b, sent=batch.sent) for a, b in ranges]
                place = self.batches.index(batch)
                self.batches[place : place + 1] = parts

    def _assign_stragglers(self, now: float) -> list[Instruction]:
        """Send what takes much longer than usual again, once, to workers that have nothing to do."""
        oldest = next(iter(self.in_flight.values()), None)
        if oldest is None or now < oldest.sent_at + TICK_S:
            return []
        sends: list[Instruction] = []
        paces = [worker.pace for worker in self.workers.values() if worker.pace is not None]
        usual = median(paces) if paces else math.inf
        for idle in [w for w in self.workers.values() if not w.in_flight and w.rests_until <= now]:
            for ticket, flight in self.in_flight.items():
                batch = flight.batch
                refused = any(name == idle.name for name, _ in batch.refusals)
                alone = batch.in_flight == 1 and not refused
                if alone and is_late(flight, usual, now) and self.is_current(ticket):
                    sends.append(self._send(batch, idle, now))
                    break
        return sends

    def _send(self, batch: Batch, worker: Worker, now: float) -> Instruction:
        ticket, self.next_ticket = self.next_ticket, self.next_ticket + 1
        self.in_flight[ticket] = worker.in_flight[ticket] = InFlight(worker, batch, now)
        self.counts.batches_sent += 1
        self.counts.batches_sent_again += batch.sent > 0
        batch.sent += 1
        batch.in_flight += 1
        return Send(ticket, worker.name, batch.start, batch.stop)

    def _check_answers(self, ended: InFlight, now: float) -> list[Instruction]:
        """Whether a request that ended without an answer did so because no worker answers any longer."""
        if now < ended.sent_at + REQUEST_TIMEOUT_S or self.answered_at > ended.sent_at:
            return []
        again = self.unanswered_at is not None and ended.sent_at >= self.unanswered_at
        self.unanswered_at = self.unanswered_at or now
        return [NoAnswer(ended.worker.name, again)]


def is_late(flight: InFlight, usual: float, now: float) -> bool:
    """Whether a request takes much longer than its worker's pace lets expect, or the usual one (seconds)."""
    pace = usual if flight.worker.pace is None else flight.worker.pace
    return now >= flight.sent_at + max(TICK_S, LATE_FACTOR * pace * flight.load)
