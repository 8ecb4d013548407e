"""Assigns particles to workers: a state machine from events to requests, without a clock or sockets.

The particles are split into one batch per worker, for the fewest workers that are as fast as all of them
together, so that only the last slots stay empty. A spare batch is refined on one lane. A batch whose
request ends without a result is sent to another worker. If no batch is waiting, a late request is sent again,
once, to an idle worker. The first result of a batch is used, later ones are ignored. A worker that gives
neither a result nor a refusal gets no requests for a while. If all workers refuse a batch, the refinement
fails.

Other coordinators use the same workers. A worker says how long a request waited there for others, so a
request is judged late by the time that it takes itself, after the usual wait at its worker.

A request stays in flight until it ends, even if its refinement is done, because the worker is still busy with
it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Literal

import msgspec

from gepf.common.bounds import MAX_PARTICLES
from gepf.common.errors import ProtocolError, SilentWorkers
from gepf.common.offer import Offer


class SchedulerLimits(msgspec.Struct, frozen=True):
    """How many requests a worker gets, and how long they may take."""

    max_in_flight: int = 2  #: requests at a worker, and spare ones per lane: when one ends, the next is there
    tick_s: float = 0.1  #: between checks of the clock; no request counts as late before
    late_factor: float = 3.0  #: a request is late after this multiple of the last time per particle
    long_wait_s: float = 0.02  #: wait for other runs at a worker, beyond which other workers are preferred
    rest_s: float = 0.5  #: pause of a worker without a result: it may be leaving or joining
    request_timeout_s: float = 30.0  #: only a hanging worker takes so long


LIMITS = SchedulerLimits()

Outcome = Literal["refined", "refused", "unavailable", "nothing"]
"""How a request ended. unavailable: the worker lacks frame or model. nothing: no answer."""


@dataclass(slots=True, eq=False)
class Batch:
    """Particles start to stop - 1 of a refinement."""

    refinement: int
    spare: bool  # comes after others
    start: int
    stop: int
    done: bool = False
    was_sent: bool = False
    in_flight: set[int] = field(default_factory=set)  # tickets
    refusals: dict[str, str] = field(default_factory=dict)  # reasons by worker


@dataclass(slots=True, eq=False)
class Worker:
    """A present worker."""

    name: str
    offer: Offer
    in_flight: set[int] = field(default_factory=set)  # tickets
    rests_until: float = -math.inf
    waits: dict[bool, float] = field(default_factory=lambda: {False: 0.0, True: 0.0})
    """Seconds that requests, or spare ones, have waited there for others: the longest lately."""

    def note_wait(self, spare: bool, seconds: float) -> None:
        """Note for how long a request has waited there."""
        self.waits[spare] = max(seconds, self.waits[spare] / 2)


@dataclass(slots=True, eq=False)
class Request:
    """A batch sent to a worker."""

    ticket: int
    worker: Worker
    batch: Batch
    sent_at: float

    @property
    def load(self) -> int:
        """Number of particles that are refined one after another."""
        offer = self.worker.offer
        parallel = offer.batch if self.batch.spare else offer.slots
        return math.ceil((self.batch.stop - self.batch.start) / parallel)


class Scheduler:
    """The state machine. Each event returns the requests to send. Times are in seconds from any origin.

    Of equally good workers those with the lowest `rank` come first: if it differs among coordinators, they
    use different workers.
    """

    def __init__(
        self, rank: Callable[[str], int] = lambda _: 0, limits: SchedulerLimits | None = None
    ) -> None:
        self._rank, self.limits = rank, limits or LIMITS
        self.workers: dict[str, Worker] = {}
        self.in_flight: dict[int, Request] = {}  # by ticket, the oldest first
        self.batches: list[Batch] = []  # of all unfinished refinements
        self.sent = self.sent_again = self.refused = 0  # requests
        # seconds per particle of a lane, in the last request with a result, and the last spare one
        self._pace = {False: math.inf, True: math.inf}
        self._answered_at = -math.inf  # by any worker

    def start(self, refinement: int, particles: int, now: float, *, spare: bool = False) -> list[Request]:
        """Start a refinement under an unused number, of this many particles; a spare one can wait."""
        ranges = split(particles, self._slots(now, spare=spare))
        self.batches += [Batch(refinement, spare, start, stop) for start, stop in ranges]
        return self.dispatch(now)

    def cancel(self, refinement: int) -> None:
        """Forget a refinement."""
        self.batches = [batch for batch in self.batches if batch.refinement != refinement]

    def join(self, name: str, offer: Offer, now: float) -> list[Request]:
        """A worker has joined, or has another offer."""
        self.workers.setdefault(name, Worker(name, offer)).offer = offer
        return self.dispatch(now)

    def leave(self, name: str, now: float) -> list[Request]:
        """A worker has left; its requests are lost."""
        worker = self.workers.pop(name, None)
        for ticket in [] if worker is None else list(worker.in_flight):
            self._remove(self.in_flight[ticket])
        return self.dispatch(now)

    def end(
        self, ticket: int, outcome: Outcome, now: float, reason: str = "", waited: float = 0.0
    ) -> list[Request]:
        """A request has ended; a refined one has `waited` for others at the worker, seconds.

        Raises ProtocolError if all workers have refused its batch, SilentWorkers after the timeout if no
        worker has answered anything since it was sent.
        """
        self._answered_at = self._answered_at if outcome == "nothing" else now
        request, is_wanted = self.in_flight.get(ticket), self.wanted(ticket) is not None
        if request is None:
            return []
        self._remove(request)
        batch, worker = request.batch, request.worker
        if outcome == "refined":
            if is_wanted:
                worker.note_wait(batch.spare, waited)
                self._pace[batch.spare] = max(0.0, now - request.sent_at - waited) / request.load
            batch.done |= is_wanted
            if all(each.done for each in self.batches if each.refinement == batch.refinement):
                self.cancel(batch.refinement)
        elif outcome == "refused":
            self.refused += 1
            batch.refusals[worker.name] = reason
            if is_wanted and batch.refusals.keys() >= self.workers.keys():
                self.cancel(batch.refinement)
                raise ProtocolError("; ".join(dict.fromkeys(batch.refusals.values())))
        else:
            worker.rests_until = now + self.limits.rest_s
            if (
                now >= request.sent_at + self.limits.request_timeout_s
                and self._answered_at <= request.sent_at
            ):
                raise SilentWorkers(worker.name)
        return self.dispatch(now)

    def dispatch(self, now: float) -> list[Request]:
        """Send waiting batches to workers with capacity, the least busy first; failing that, late ones again.

        A spare batch delays no other.
        """
        waiting = [batch for batch in self.batches if not (batch.done or batch.in_flight)]
        sends: list[Request] = []
        for batch in sorted(waiting, key=lambda batch: batch.spare):
            by_all = batch.refusals.keys() >= self.workers.keys()
            ready, spare = self._awake(now), batch.spare
            most = self.limits.max_in_flight
            able = [w for w in ready if self._count(w, batch) < most * (1 + spare * w.offer.lanes)]
            free = [w for w in able if by_all or w.name not in batch.refusals]
            if free:
                sends.append(self._send(batch, min(free, key=self._preference), now))
        return sends or self._send_late_again(waiting, now)

    def wanted(self, ticket: int) -> Batch | None:
        """The batch of a ticket, if its result is still needed."""
        request = self.in_flight.get(ticket)
        is_wanted = request is not None and not request.batch.done and request.batch in self.batches
        return request.batch if request is not None and is_wanted else None

    def _slots(self, now: float, *, spare: bool) -> list[int]:
        """The slots of all workers, the preferred ones first; [1] without workers."""
        workers = sorted(self.workers.values(), key=lambda w: (w.rests_until > now, *self._preference(w)))
        return [worker.offer.batch if spare else worker.offer.slots for worker in workers] or [1]

    def _preference(self, worker: Worker) -> tuple[int, bool, int]:
        """A sort key, lowest first: few requests of our own at the worker, and no wait for others."""
        return len(worker.in_flight), worker.waits[False] > self.limits.long_wait_s, self._rank(worker.name)

    def _awake(self, now: float) -> list[Worker]:
        return [worker for worker in self.workers.values() if worker.rests_until <= now]

    def _count(self, worker: Worker, batch: Batch) -> int:
        """Number of requests at a worker that this batch does not precede."""
        return sum(self.in_flight[ticket].batch.spare <= batch.spare for ticket in worker.in_flight)

    def _send_late_again(self, waiting: Sequence[Batch], now: float) -> list[Request]:
        """Send late batches to workers that would begin them at once, unless others wait."""
        late = [request.batch for request in self.in_flight.values() if self._is_late(request, now)]
        sends: list[Request] = []
        for batch in sorted(late, key=lambda batch: batch.spare):
            idle = [w for w in self._awake(now) if not self._count(w, batch) and w.name not in batch.refusals]
            others = any(each.spare <= batch.spare for each in waiting)
            if idle and len(batch.in_flight) == 1 and not others:
                sends.append(self._send(batch, idle[0], now))
        return sends

    def _is_late(self, request: Request, now: float) -> bool:
        spare = request.batch.spare
        usual = self.limits.late_factor * (self._pace[spare] * request.load + request.worker.waits[spare])
        return self.wanted(request.ticket) is not None and now >= request.sent_at + max(
            self.limits.tick_s, usual
        )

    def _send(self, batch: Batch, worker: Worker, now: float) -> Request:
        request = self.in_flight[self.sent] = Request(self.sent, worker, batch, now)
        self.sent += 1
        self.sent_again += batch.was_sent
        batch.was_sent = True
        for each in (batch, worker):
            each.in_flight.add(request.ticket)
        return request

    def _remove(self, request: Request) -> None:
        """Remove a request from those in flight."""
        del self.in_flight[request.ticket]
        for each in (request.batch, request.worker):
            each.in_flight.remove(request.ticket)


def split(particles: int, slots: Sequence[int]) -> list[tuple[int, int]]:
    """Successive ranges (start, stop) of particles, one per request, for workers with these numbers of slots.

    All take the same number of rounds, the last one perhaps fewer; workers that are not needed get nothing.
    If a request would have too many particles, workers get several.
    """
    slots = [min(count, MAX_PARTICLES) for count in slots]
    most = MAX_PARTICLES // max(slots)  # rounds of a request
    requests = math.ceil(particles / (most * sum(slots)))  # for each worker
    rounds = math.ceil(particles / max(1, requests * sum(slots)))
    ends = accumulate((rounds * count for count in slots * requests), initial=0)
    return [(start, min(stop, particles)) for start, stop in pairwise(ends) if start < particles]
