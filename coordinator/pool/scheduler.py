"""Assigns particles to workers: a state machine from events to requests, without clock and socket.

The particles are split into one batch per worker, in proportion to the lanes. A spare batch is refined on one
lane. A batch whose request ends without a result is sent to another worker. If no batch is waiting, a late
request is sent again, once, to an idle worker. The first result of a batch is used, later ones are ignored. A
worker that gives neither a result nor a refusal gets no requests for a while. If all workers refuse a batch,
the refinement fails.

A request stays in flight until it ends, even if its refinement is done, because the worker is still busy with
it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Literal

from gepf.common.bounds import MAX_PARTICLES
from gepf.common.errors import ProtocolError, SilentWorkers

MAX_IN_FLIGHT = 2  # requests at one worker, and spare ones per lane: the next one is there when one ends
TICK_S = 0.1  # between checks of the clock; no request is late before
LATE_FACTOR = 3.0  # a request is late after this multiple of the last time per particle
REST_S = 0.5  # pause of a worker without a result: it may be leaving or joining
REQUEST_TIMEOUT_S = 30.0  # only a hanging worker takes so long

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
    lanes: int  # particles refined in parallel
    in_flight: set[int] = field(default_factory=set)  # tickets
    rests_until: float = -math.inf


@dataclass(slots=True, eq=False)
class Request:
    """A batch sent to a worker."""

    ticket: int
    worker: Worker
    batch: Batch
    sent_at: float

    @property
    def load(self) -> int:
        """Particles per lane that refines them."""
        lanes = 1 if self.batch.spare else self.worker.lanes
        return math.ceil((self.batch.stop - self.batch.start) / lanes)


class Scheduler:
    """The state machine. Each event returns the requests to send. Times are in seconds from any origin."""

    def __init__(self) -> None:
        self.workers: dict[str, Worker] = {}
        self.in_flight: dict[int, Request] = {}  # by ticket, the oldest first
        self.batches: list[Batch] = []  # of all unfinished refinements
        self.sent = self.sent_again = self.refused = 0  # requests
        # seconds per particle and lane, in the last request with a result; of spare ones with their wait
        self._pace = {False: math.inf, True: math.inf}
        self._answered_at = -math.inf  # by any worker

    def start(self, refinement: int, particles: int, now: float, *, spare: bool = False) -> list[Request]:
        """Start a refinement, which has an unused number, of so many particles; a spare one can wait."""
        workers = sorted(self.workers.values(), key=lambda w: (w.rests_until > now, len(w.in_flight)))
        lanes = [1 if spare else worker.lanes for worker in workers] or [1]
        rounds = max(lanes) * particles / sum(lanes) / MAX_PARTICLES
        ranges = split(particles, lanes * max(1, math.ceil(rounds)))
        self.batches += [Batch(refinement, spare, start, stop) for start, stop in ranges]
        return self.dispatch(now)

    def cancel(self, refinement: int) -> None:
        """Forget a refinement."""
        self.batches = [batch for batch in self.batches if batch.refinement != refinement]

    def join(self, name: str, lanes: int, now: float) -> list[Request]:
        """A worker has joined, or announced its number of lanes."""
        self.workers.setdefault(name, Worker(name, lanes)).lanes = lanes
        return self.dispatch(now)

    def leave(self, name: str, now: float) -> list[Request]:
        """A worker has left; its requests are lost."""
        worker = self.workers.pop(name, None)
        for ticket in [] if worker is None else list(worker.in_flight):
            self._remove(self.in_flight[ticket])
        return self.dispatch(now)

    def end(self, ticket: int, outcome: Outcome, now: float, reason: str = "") -> list[Request]:
        """A request has ended.

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
            self._pace[batch.spare] = (now - request.sent_at) / request.load
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
            worker.rests_until = now + REST_S
            if now >= request.sent_at + REQUEST_TIMEOUT_S and self._answered_at <= request.sent_at:
                raise SilentWorkers(worker.name)
        return self.dispatch(now)

    def dispatch(self, now: float) -> list[Request]:
        """Send waiting batches to workers with capacity, the least busy first; then late ones again.

        A spare batch delays no other.
        """
        waiting = [batch for batch in self.batches if not (batch.done or batch.in_flight)]
        sends: list[Request] = []
        for batch in sorted(waiting, key=lambda batch: batch.spare):
            by_all = batch.refusals.keys() >= self.workers.keys()
            ready, spare = self._awake(now), batch.spare
            able = [w for w in ready if self._count(w, batch) < MAX_IN_FLIGHT * (1 + spare * w.lanes)]
            free = [w for w in able if by_all or w.name not in batch.refusals]
            if free:
                sends.append(self._send(batch, min(free, key=lambda w: len(w.in_flight)), now))
        return sends or self._send_late_again(waiting, now)

    def wanted(self, ticket: int) -> Batch | None:
        """The batch of a ticket, if its result is still needed."""
        request = self.in_flight.get(ticket)
        is_wanted = request is not None and not request.batch.done and request.batch in self.batches
        return request.batch if request is not None and is_wanted else None

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
        usual = LATE_FACTOR * self._pace[request.batch.spare] * request.load
        return self.wanted(request.ticket) is not None and now >= request.sent_at + max(TICK_S, usual)

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


def split(particles: int, lanes: Sequence[int]) -> list[tuple[int, int]]:
    """Successive ranges (start, stop) in proportion to the lanes of the workers; none is empty."""
    total = sum(lanes)
    ends = [math.ceil(particles * share / total) for share in accumulate(lanes, initial=0)]
    return [(start, stop) for start, stop in pairwise(ends) if start < stop]
