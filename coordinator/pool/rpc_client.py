"""Carries out the scheduler's instructions on the bus, and hands it the replies; owns the clock."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue

from common.bounds import most_covariances
from common.errors import ProtocolError, SilentWorkers, VersionError
from common.protocol import keys
from common.protocol.messages import RefineRequest, decode_refined, decode_refusal, encode_request
from common.refinement import Refined, concatenate
from common.transport.bus import Bus
from common.transport.channels import RequestSender
from coordinator.pool.dispatch.events import (
    LARGEST_BATCH,
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
    Ticked,
    Unavailable,
    WorkerJoined,
    WorkerLeft,
)
from coordinator.pool.dispatch.scheduler import REQUEST_TIMEOUT_S, TICK_S, Scheduler
from coordinator.pool.local_workers import LocalWorkers
from coordinator.pool.options import NoWorkerTimeout

NO_WORKER_ANSWERS = (
    f"workers are there, and none of them answers within {REQUEST_TIMEOUT_S:.0f} s: the way to them is "
    "broken, they hang, or they have too much to do at once, with so many particles or points"
)


@dataclass(frozen=True, slots=True)
class Reply:
    """The payload of a reply; from a thread of the bus."""

    ticket: int
    payload: bytes


@dataclass(slots=True, eq=False)
class Refinement:
    """One request: it goes out in batches, and comes back in the order of its particles."""

    request: RefineRequest  # for all particles
    due: float = math.inf  # when to do with the particles that are refined, by the monotonic clock
    complete: bool = False
    _received: dict[int, Refined] = field(default_factory=dict)  # by ticket
    _parts: dict[int, Refined] = field(default_factory=dict)  # by first particle

    @property
    def largest_batch(self) -> int:
        """How many particles one reply may be about."""
        most = most_covariances(self.request.poses.shape[1])
        return min(LARGEST_BATCH, most) if self.request.covariance else LARGEST_BATCH

    def is_due(self, now: float) -> bool:
        """Whether to do with what has been refined; the first reply is waited for."""
        return now >= self.due and bool(self._parts)

    def receive(self, ticket: int, payload: bytes, particles: int) -> None:
        """Keep a batch's reply until it is accepted; ProtocolError if it makes no sense."""
        shape = particles, self.request.poses.shape[1]
        self._received[ticket] = decode_refined(payload, shape, covariance=self.request.covariance)

    def accept(self, ticket: int, start: int) -> None:
        """A reply is the first for the particles from `start` on."""
        self._parts[start] = self._received.pop(ticket)

    def gather(self) -> Refined:
        """What has been refined, in the order of the particles, and NaN for the rest."""
        if len(self._parts) == 1 and self.complete:
            return self._parts[0]
        parts: list[Refined] = []
        stop = 0
        for start, part in [*sorted(self._parts.items()), (len(self.request.poses), None)]:
            if start > stop:
                parts.append((part or parts[-1]).unanswered(start - stop))
            if part is not None:
                parts.append(part)
                stop = start + len(part.poses)
        return concatenate(parts)


class RpcClient:
    """One refinement after the other, between the scheduler and the workers.

    What the bus's own threads notice waits in an inbox until `begin`, `finish` or `step` handles it. `report`
    is called with a line for people when workers come, go, or are missing.
    """

    def __init__(
        self, bus: Bus, local: LocalWorkers, timeout: NoWorkerTimeout, report: Callable[[str], None]
    ) -> None:
        self.scheduler = Scheduler()
        self.malformed = 0  # replies
        self.seen: set[str] = set()  # workers that have ever been there
        self._bus = bus
        self._local = local
        self._timeout = timeout
        self._report = report
        self._senders: dict[str, RequestSender] = {}  # by worker
        self._inbox: SimpleQueue[Event | Reply] = SimpleQueue()
        self._refinement: Refinement | None = None  # begun last
        self._next_poll = 0.0
        self._unavailable = ""  # reported last
        bus.watch(keys.ANY_WORKER_LANES, self._notice_lanes)
        bus.watch(keys.ANY_WORKER_ALIVE, self._notice)

    @property
    def lanes(self) -> int:
        """Lanes of all workers that are there."""
        return sum(worker.lanes for worker in self.scheduler.workers.values())

    def begin(self, refinement: Refinement) -> None:
        """Send all batches of a refinement; what is left of the one before is given up."""
        if self.scheduler.batches:
            self._handle(Started(0))
        self._catch_up()
        self._refinement = refinement
        particles = len(refinement.request.poses)
        self._handle(Started(particles, refinement.due < math.inf, refinement.largest_batch))

    def finish(self, refinement: Refinement) -> None:
        """Wait until the refinement that was begun last is complete, or due and refined in part."""
        if refinement is not self._refinement:
            raise RuntimeError("this request was given up when another one was submitted")
        self._catch_up()  # what is there already is in time, however long that took
        while not (refinement.complete or refinement.is_due(time.monotonic())):
            self.step(refinement.due)

    def step(self, due: float = math.inf) -> None:
        """Handle what happens next, and look at the clock and the workers now and then."""
        now = time.monotonic()
        if now >= self._next_poll:
            self._next_poll = now + TICK_S
            self._poll(now)
            self._handle(Ticked())
            return
        with suppress(Empty):
            patience = min(TICK_S, due - now) if due > now else TICK_S
            self._handle(self._interpret(self._inbox.get(timeout=patience)))

    def _notice(self, key: str, alive: bool) -> None:
        """A worker has come or gone; called on a thread of the bus."""
        worker = keys.worker_of(key)
        self._inbox.put(WorkerJoined(worker) if alive else WorkerLeft(worker))

    def _notice_lanes(self, key: str, alive: bool) -> None:
        """A worker has announced how many lanes it has; called on a thread of the bus."""
        if alive:
            self._inbox.put(LanesCounted(keys.worker_of(key), keys.lanes_of(key)))

    def _poll(self, now: float) -> None:
        """Start local workers that have died again; NoWorkers if no worker has been there for too long."""
        self._local.end_absent(self._senders, now)
        for line in self._local.restart_dead():
            self._report(line)
        missing = None if self._senders else self._timeout.check(now)
        if missing is not None:
            self._report(missing)

    def _catch_up(self) -> None:
        """Handle what has happened since."""
        while not self._inbox.empty():
            self._handle(self._interpret(self._inbox.get()))

    def _interpret(self, arrival: Event | Reply) -> Event:
        match arrival:
            case Reply():
                return self._read(arrival)
            case Unavailable(ticket, reason):
                flight = self.scheduler.in_flight.get(ticket)
                if flight is not None and reason != self._unavailable:
                    self._unavailable = reason
                    self._report(f"worker {flight.worker.name} waits: {reason}")
            case WorkerJoined(worker):
                self._add(worker)
            case WorkerLeft(worker):
                sender = self._senders.pop(worker, None)
                if sender is not None:
                    sender.close()
                    self._report(f"worker {worker} left")
        return arrival

    def _add(self, worker: str) -> None:
        self._local.mark_serving(worker)
        if worker not in self._senders:
            self._senders[worker] = self._bus.request_sender(keys.worker_refine(worker), REQUEST_TIMEOUT_S)
            self.seen.add(worker)
            self._timeout.reset()
            self._report(f"worker {worker} joined")

    def _read(self, reply: Reply) -> Event:
        ticket, replied = reply.ticket, Replied(reply.ticket)
        flight = self.scheduler.in_flight.get(ticket)
        if flight is None or self._refinement is None or not self.scheduler.is_current(ticket):
            return replied
        try:
            self._refinement.receive(ticket, reply.payload, flight.batch.stop - flight.batch.start)
        except ProtocolError as error:
            self.malformed += 1
            self._report(f"worker {flight.worker.name} sent a reply that makes no sense: {error}")
            return Refused(ticket, f"a reply made no sense: {error}")
        return replied

    def _handle(self, event: Event) -> None:
        for instruction in self.scheduler.handle(event, time.monotonic()):
            self._carry_out(instruction)

    def _carry_out(self, instruction: Instruction) -> None:
        refinement = self._refinement
        assert refinement is not None
        match instruction:
            case Send():
                self._send(instruction, refinement.request)
            case Accept(ticket, start):
                refinement.accept(ticket, start)
            case Done():
                refinement.complete = True
            case NoAnswer(worker, again):
                self._report(f"worker {worker} is there, and has not answered for {REQUEST_TIMEOUT_S:.0f} s")
                if again:
                    raise SilentWorkers(NO_WORKER_ANSWERS)
            case Fail(reason):
                raise ProtocolError(f"no worker can refine frame {refinement.request.frame}: {reason}")

    def _send(self, send: Send, request: RefineRequest) -> None:
        self._senders[send.worker].send(
            encode_request(request.batch(send.start, send.stop)),
            on_reply=lambda payload: self._inbox.put(Reply(send.ticket, payload)),
            on_refusal=lambda payload: self._inbox.put(read_refusal(send.ticket, payload)),
            on_end=lambda: self._inbox.put(Ended(send.ticket)),
        )


def read_refusal(ticket: int, payload: bytes) -> Event:
    """A worker's reason, or the end of a request of which the bus itself knows no more."""
    try:
        refusal = decode_refusal(payload)
    except VersionError as error:
        return Refused(ticket, f"{error}; install the same gepf on both sides")
    except ProtocolError:
        return Ended(ticket)
    return (Unavailable if refusal.retryable else Refused)(ticket, refusal.reason)
