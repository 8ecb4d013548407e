"""Carries the scheduler's instructions out on the bus, and hands it the answers; owns the clock."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue

from common.errors import ProtocolError, SilentWorkers
from common.protocol import keys
from common.protocol.messages import encode_request
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
from coordinator.pool.dispatch.hearing import REQUEST_TIMEOUT
from coordinator.pool.dispatch.scheduler import Scheduler
from coordinator.pool.refinement import Refinement
from coordinator.pool.replies import Reply, read_refusal
from coordinator.pool.worker_registry import WorkerRegistry

TICK = 0.1  # seconds between looks at the clock and at the local workers
NOBODY_ANSWERS = (
    f"workers are there, and none of them answers within {REQUEST_TIMEOUT:.0f} s: the way to them is broken, "
    "they hang, or they have too much to do at once, with so many particles or points"
)


class Exchange:
    """One refinement after the other, between the scheduler and the workers.

    What the bus's own threads notice waits in an inbox until `begin`, `finish` or `step` handles it. `report`
    is called with a line for people.
    """

    def __init__(self, workers: WorkerRegistry, report: Callable[[str], None]) -> None:
        self.scheduler = Scheduler()
        self.malformed = 0  # replies
        self._workers = workers
        self._report = report
        self._inbox: SimpleQueue[Event | Reply] = SimpleQueue()
        self._refinement: Refinement | None = None  # begun last
        self._next_poll = 0.0
        self._unavailable = ""  # reported last

    def notice(self, key: str, alive: bool) -> None:
        """A worker's key has come or gone; may be called from any thread."""
        worker = keys.worker_of(key)
        self._inbox.put(WorkerJoined(worker) if alive else WorkerLeft(worker))

    def notice_lanes(self, key: str, alive: bool) -> None:
        """A worker has said how many lanes it has; may be called from any thread."""
        if alive:
            self._inbox.put(LanesCounted(keys.worker_of(key), keys.lanes_of(key)))

    @property
    def lanes(self) -> int:
        """Lanes of all workers that are there."""
        return sum(worker.lanes for worker in self.scheduler.workers.values())

    def begin(self, refinement: Refinement) -> None:
        """Send all batches of a refinement; what is left of the one before is given up."""
        if self.scheduler.batches:
            self._handle(JobStarted(0))
        self._catch_up()
        self._refinement = refinement
        in_parts = refinement.due < math.inf
        self._handle(JobStarted(refinement.particles, in_parts, refinement.spare, refinement.most))

    def finish(self, refinement: Refinement) -> None:
        """Wait until the refinement that was begun last is complete, or due and answered in part."""
        if refinement is not self._refinement:
            raise RuntimeError("this request was given up when another one was submitted")
        self._catch_up()  # what is there already is in time, however long that took
        while not (refinement.complete or refinement.is_due(time.monotonic())):
            self.step(refinement.due)

    def step(self, due: float = math.inf) -> None:
        """Handle what happens next, and look at the clock and the workers now and then."""
        now = time.monotonic()
        if now >= self._next_poll:
            self._next_poll = now + TICK
            self._workers.poll(now)
            self._handle(Ticked())
            return
        with suppress(Empty):
            patience = min(TICK, due - now) if due > now else TICK
            self._handle(self._interpret(self._inbox.get(timeout=patience)))

    def _catch_up(self) -> None:
        """Handle what has happened since."""
        while not self._inbox.empty():
            self._handle(self._interpret(self._inbox.get()))

    def _interpret(self, arrival: Event | Reply) -> Event:
        match arrival:
            case Reply():
                return self._read(arrival)
            case Unavailable(ticket, reason):
                self._report_unavailable(ticket, reason)
            case WorkerJoined(worker):
                self._workers.add(worker)
            case WorkerLeft(worker):
                self._workers.remove(worker)
        return arrival

    def _read(self, reply: Reply) -> Event:
        ticket, replied = reply.ticket, Replied(reply.ticket, reply.at)
        flight = self.scheduler.flights.get(ticket)
        if flight is None or self._refinement is None or not self.scheduler.is_current(ticket):
            return replied
        try:
            self._refinement.receive(ticket, reply.payload, flight.batch.stop - flight.batch.start)
        except ProtocolError as error:
            self.malformed += 1
            self._report(f"worker {flight.worker.name} sent a reply that makes no sense: {error}")
            return Refused(ticket, f"a reply made no sense: {error}")
        return replied

    def _report_unavailable(self, ticket: int, reason: str) -> None:
        flight = self.scheduler.flights.get(ticket)
        if flight is not None and reason != self._unavailable:
            self._unavailable = reason
            self._report(f"worker {flight.worker.name} waits: {reason}")

    def _handle(self, event: Event) -> None:
        for instruction in self.scheduler.handle(event, time.monotonic()):
            self._carry_out(instruction)

    def _carry_out(self, instruction: Instruction) -> None:
        refinement = self._refinement
        assert refinement is not None
        match instruction:
            case Send():
                self._send(instruction)
            case Accept(ticket, start):
                refinement.accept(ticket, start)
            case Done():
                refinement.complete = True
            case Silence(worker, again):
                self._report(f"worker {worker} is there, and has not answered for {REQUEST_TIMEOUT:.0f} s")
                if again:
                    raise SilentWorkers(NOBODY_ANSWERS)
            case Fail(reason):
                raise ProtocolError(f"no worker can refine frame {refinement.request.frame}: {reason}")

    def _send(self, send: Send) -> None:
        assert self._refinement is not None
        self._workers.asker(send.worker).ask(
            encode_request(self._refinement.request.batch(send.start, send.stop)),
            on_reply=lambda payload: self._inbox.put(Reply(send.ticket, payload, time.monotonic())),
            on_refusal=lambda payload: self._inbox.put(read_refusal(send.ticket, payload)),
            on_end=lambda: self._inbox.put(Ended(send.ticket)),
        )
