"""Sends the requests of the scheduler over the bus, and reports their ends to it; owns the clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from queue import Empty, SimpleQueue

from gepf.common.errors import NoWorkers, ProtocolError, SilentWorkers, VersionError
from gepf.common.protocol import keys
from gepf.common.protocol.messages import RefineRequest, decode_refined, decode_refusal, encode_request
from gepf.common.refinement import Refined, concatenate
from gepf.common.transport.bus import Bus
from gepf.common.transport.channels import Ending, RequestSender
from gepf.coordinator.pool.local_worker import LocalWorker
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.scheduler import REQUEST_TIMEOUT_S, TICK_S, Outcome, Request, Scheduler
from gepf.coordinator.stopwatch import NOTICE_S


@dataclass(slots=True, eq=False)
class Refinement:
    """A refinement in progress, which is sent in batches; ends with `result` or `cancel`."""

    client: RpcClient
    number: int
    request: RefineRequest  # for all particles
    parts: dict[int, Refined] = field(default_factory=dict)  # by first particle

    @property
    def is_ready(self) -> bool:
        """Whether `result` would return at once."""
        self.client.catch_up()
        return self.is_over

    def result(self) -> Refined:
        """Wait for the particles in the order of submission.

        Raises NoWorkers if there is no worker within the timeout, SilentWorkers if no worker answers,
        ProtocolError if no worker can serve the request, BusError if the transport fails or local workers do
        not start.
        """
        try:
            while not self.is_over:
                self.client.step()
        finally:
            self.cancel()
        return concatenate([self.parts[start] for start in sorted(self.parts)])

    def cancel(self) -> None:
        """Forget it: its result is not needed."""
        self.client.forget(self)

    @property
    def is_over(self) -> bool:
        """Whether all particles are refined."""
        return sum(len(part.poses) for part in self.parts.values()) == len(self.request.particles.poses)


class RpcClient:
    """Performs refinements, between the scheduler and the workers.

    Events from threads of the bus are queued until the coordinator's thread handles them. `report` is
    called with a message for the user when workers join, leave, or are missing.
    """

    def __init__(self, bus: Bus, pool: Pool, local: LocalWorker, report: Callable[[str], None]) -> None:
        self.scheduler = Scheduler()
        self.malformed = 0  # replies
        self.seen: set[str] = set()  # all workers so far
        self._bus = bus
        self._pool = pool
        self._local = local
        self._report = report
        self._lanes: dict[str, int] = {}  # by worker, present or not
        self._senders: dict[str, RequestSender] = {}  # by worker
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._refinements: dict[int, Refinement] = {}  # the unfinished ones by number
        self._begun = 0  # refinements
        self._next_poll = 0.0
        self._alone_since: float | None = None  # start of the time without a worker
        self._alone_reported = False
        self._waits_for = ""  # missing data, as last reported
        bus.watch(keys.of_worker("*", "lanes/*"), self._queued(self._count))
        bus.watch(keys.of_worker("*", "alive"), self._queued(self._notice))

    @property
    def lanes(self) -> int:
        """Number of lanes of all present workers."""
        return sum(worker.lanes for worker in self.scheduler.workers.values())

    @property
    def frames(self) -> set[int]:
        """The frames of all unfinished refinements."""
        return {each.request.frame for each in self._refinements.values()}

    def begin(self, request: RefineRequest) -> Refinement:
        """Send all batches of a request; if it is spare, after others."""
        self.catch_up()
        number, self._begun = self._begun, self._begun + 1
        self._refinements[number] = refinement = Refinement(self, number, request)
        particles, now = len(request.particles.poses), time.monotonic()
        self._send(self.scheduler.start(number, particles, now, spare=request.particles.spare))
        return refinement

    def forget(self, refinement: Refinement) -> None:
        """Send nothing more of a refinement, and ignore its answers."""
        self.scheduler.cancel(refinement.number)
        self._refinements.pop(refinement.number, None)

    def step(self) -> None:
        """Handle the next event, or check clock and workers if it is time."""
        now = time.monotonic()
        if now >= self._next_poll:
            self._poll(now)
            return
        with suppress(Empty):
            self._inbox.get(timeout=TICK_S)()

    def catch_up(self) -> None:
        """Handle all queued events, and check clock and workers if it is time."""
        while not self._inbox.empty():
            self._inbox.get()()
        now = time.monotonic()
        if now >= self._next_poll:
            self._poll(now)

    def _queued(self, handle: Callable[..., None]) -> Callable[..., None]:
        """A function for threads of the bus, by which the coordinator's thread calls `handle` later."""
        return lambda *event: self._inbox.put(partial(handle, *event))

    def _poll(self, now: float) -> None:
        """Check the workers, and send what is due."""
        self._next_poll = now + TICK_S
        self._check(now)
        self._send(self.scheduler.dispatch(now))

    def _check(self, now: float) -> None:
        """Check the local worker; report once that there is no worker; raise NoWorkers after the timeout."""
        local = self.scheduler.workers.get(self._local.name)
        line = self._local.look_after(now, owes=local is not None and bool(local.in_flight))
        if line is not None:
            self._report(line)
        if self._senders:
            return
        self._alone_since = now if self._alone_since is None else self._alone_since
        alone, limit = now - self._alone_since, self._pool.worker_timeout
        if limit is not None and alone > limit:
            self._alone_since, self._alone_reported = None, False
            where = self._pool.listen or self._pool.connect or "ENDPOINT"
            raise NoWorkers(f"no worker came within {limit:g} s; start gepf-worker --connect {where}")
        if alone > NOTICE_S and not self._alone_reported:
            self._alone_reported = True
            self._report(
                "the local worker is not ready yet; the first time, compiling takes about a minute"
                if self._pool.lanes
                else "no worker is connected; waiting for one"
            )

    def _count(self, key: str, alive: bool) -> None:
        """A worker has announced its number of lanes."""
        if alive:
            worker = keys.owner_of(key)
            self._lanes[worker] = keys.lanes_of(key)
            if worker in self._senders:
                self._notice(key, alive)

    def _notice(self, key: str, alive: bool) -> None:
        """A worker has joined or left."""
        worker, now = keys.owner_of(key), time.monotonic()
        if alive and worker not in self._senders:
            refine = keys.of_worker(worker, "refine")
            self._senders[worker] = self._bus.request_sender(refine, REQUEST_TIMEOUT_S)
            self.seen.add(worker)
            self._alone_since, self._alone_reported = None, False
            self._report(f"worker {worker} joined")
        elif not alive and worker in self._senders:
            self._senders.pop(worker).close()
            self._report(f"worker {worker} left")
        if alive:
            self._send(self.scheduler.join(worker, self._lanes.get(worker, 1), now))
        else:
            self._send(self.scheduler.leave(worker, now))

    def _send(self, requests: list[Request]) -> None:
        for request in requests:
            whole, batch = self._refinements[request.batch.refinement].request, request.batch
            part = replace(whole, particles=whole.particles.part(batch.start, batch.stop))
            worker = request.worker.name
            on_end = self._queued(partial(self._end, request.ticket, worker))
            self._senders[worker].send(encode_request(part), on_end)

    def _end(self, ticket: int, worker: str, ending: Ending, payload: bytes) -> None:
        """A request has ended."""
        outcome: Outcome = "nothing"
        reason = ""
        if worker == self._local.name and ending != "nothing":
            self._local.heard()
        if ending == "reply":
            outcome, reason = self._receive(ticket, worker, payload)
        elif ending == "refusal":
            outcome, reason = read_refusal(payload)
            if outcome == "unavailable" and reason != self._waits_for:
                self._waits_for = reason
                self._report(f"worker {worker} waits: {reason}")
        try:
            self._send(self.scheduler.end(ticket, outcome, time.monotonic(), reason))
        except SilentWorkers as error:
            raise SilentWorkers(
                f"workers are connected, but none answers within {REQUEST_TIMEOUT_S:.0f} s (last {worker}): "
                "the connection is broken, they do not respond, or a request has too many particles or points"
            ) from error
        except ProtocolError as error:
            raise ProtocolError(f"no worker can refine the particles: {error}") from error

    def _receive(self, ticket: int, worker: str, payload: bytes) -> tuple[Outcome, str]:
        """Keep a useful reply, unless it is invalid."""
        batch = self.scheduler.wanted(ticket)
        if batch is None:
            return "refined", ""
        refinement = self._refinements[batch.refinement]
        asked = refinement.request.particles
        shape = batch.stop - batch.start, asked.poses.shape[1]
        try:
            part = decode_refined(payload, shape, covariance=asked.covariance)
        except ProtocolError as error:
            self.malformed += 1
            self._report(f"worker {worker} sent an invalid reply: {error}")
            return "refused", f"invalid reply: {error}"
        refinement.parts[batch.start] = part
        return "refined", ""


def read_refusal(payload: bytes) -> tuple[Outcome, str]:
    """The worker's reason for a refusal, or the outcome of a request that ended without a reply."""
    try:
        refusal = decode_refusal(payload)
    except VersionError as error:
        return "refused", f"{error}; install the same version of gepf on both sides"
    except ProtocolError:
        return "nothing", ""
    return "unavailable" if refusal.retryable else "refused", refusal.reason
