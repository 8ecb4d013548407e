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

from dataclasses import dataclass, field

from coordinator.pool.dispatch.batches import cut, one_each, several_each
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
    Ticked,
    Unavailable,
    WorkerJoined,
    WorkerLeft,
)
from coordinator.pool.dispatch.hearing import Hearing
from coordinator.pool.dispatch.lateness import Lateness
from coordinator.pool.dispatch.workload import (
    WINDOW,
    Batch,
    Flight,
    Worker,
    least_busy,
    rank,
    strike,
)

PAUSE = 0.1  # seconds after a request that nothing came of: the worker may just have gone, or come
REFUSALS_LEAST = 3  # of a batch, before it fails the job


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
    lateness: Lateness = field(default_factory=Lateness)
    hearing: Hearing = field(default_factory=Hearing)
    next_ticket: int = 0
    may_wait: bool = False  # whether there may be batches that wait; to look costs time with many

    def handle(self, event: Event, now: float) -> list[Instruction]:
        """What is to be done about an event at time `now`, seconds from any origin."""
        match event:
            case JobStarted(particles, in_parts, spare, most):
                workers = self._in_turn(now)
                shares = several_each(particles, spare, workers) if in_parts else one_each(particles, workers)
                self.batches = cut(shares, most)
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
                self.hearing.heard(now)
                outcome = self._accept(ticket, now if at is None else at)
            case Refused(ticket, reason):
                self.hearing.heard(now)
                outcome = self._refuse(ticket, reason, now)
            case Unavailable(ticket):
                self.hearing.heard(now)
                self._give_up(ticket, now)
                outcome = []
            case Ended(ticket):
                ended = self._give_up(ticket, now)
                return [*self._assign(now), *self.hearing.ended(ended, now)]
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
        self.lateness.learn(flight, at)
        if not current:
            return []
        flight.batch.done = True
        accepted = Accept(ticket, flight.batch.start)
        if not all(batch.done for batch in self.batches):
            return [accepted]
        self.batches = []
        return [accepted, Done()]

    def _in_turn(self, now: float) -> list[Worker]:
        """All workers in the order in which they get batches: those that rest come last."""
        ready = [worker for *_, worker in sorted(rank(self.workers.values(), now))]
        return ready + [worker for worker in self.workers.values() if worker.rests_until > now]

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
            parts = one_each(batch.stop - batch.start, workers, after=batch)
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
        if not self.lateness.may_be(self.flights.values(), now):
            return sends
        for worker in self.workers.values():
            if worker.flights or worker.rests_until > now:
                continue
            current = [flight for ticket, flight in self.flights.items() if self.is_current(ticket)]
            late = self.lateness.latest(current, worker, now)
            if late is not None:
                sends.append(self._send(late.batch, worker, now))
        return sends

    def _send(self, batch: Batch, worker: Worker, now: float) -> Instruction:
        ticket, self.next_ticket = self.next_ticket, self.next_ticket + 1
        self.flights[ticket] = worker.flights[ticket] = Flight(worker, batch, now)
        self.counts.batches_sent += 1
        self.counts.batches_sent_again += batch.sent > 0
        batch.sent += 1
        return Send(ticket, worker.name, batch.start, batch.stop)
