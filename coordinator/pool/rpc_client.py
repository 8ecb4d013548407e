"""Sends the requests of the scheduler over the bus, and reports to it how they ended; owns the clock."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from queue import Empty, SimpleQueue

from gepf.common.errors import NoWorkers, ProtocolError, SilentWorkers, VersionError
from gepf.common.offer import Offer
from gepf.common.protocol import keys
from gepf.common.protocol.messages import RefineRequest, decode_refined, decode_refusal, encode_request
from gepf.common.refinement import Refined, concatenate
from gepf.common.transport.bus import Bus
from gepf.common.transport.channels import Ending, RequestSender
from gepf.coordinator.notices import NOTICE_S
from gepf.coordinator.pool.local_worker import LocalWorker
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.scheduler import Outcome, Request, Scheduler


@dataclass(slots=True, eq=False)
class Refinement:
    """A refinement in progress, which is sent in batches; ends with `result` or `cancel`."""

    client: RpcClient
    number: int
    request: RefineRequest  # for all particles
    parts: dict[int, Refined] = field(default_factory=dict)  # by first particle

    def poll(self) -> bool:
        """Handle what has arrived; returns whether `result` would return at once."""
        self.client.catch_up()
        return self.is_over

    def result(self) -> Refined:
        """Wait for the refined particles, in the order of submission.

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

    def __init__(
        self, bus: Bus, run: str, pool: Pool, local: LocalWorker, report: Callable[[str], None]
    ) -> None:
        self.scheduler = Scheduler(lambda worker: zlib.crc32(f"{run} {worker}".encode()))
        self.malformed = 0  # replies
        self.seen: dict[str, str] = {}  # processors of all workers so far, by name
        self._refine = f"refine/{keys.coordinator_of(run)}"
        self._bus = bus
        self._pool = pool
        self._local = local
        self._report = report
        self._offers: dict[str, dict[str, Offer]] = {}  # by worker and token, of any kind
        self._senders: dict[str, RequestSender] = {}  # by worker
        self._inbox: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._refinements: dict[int, Refinement] = {}  # the unfinished ones by number
        self._begun = 0  # refinements
        self._next_poll = 0.0
        self._alone_since: float | None = None  # start of the time without a worker
        self._alone_reported = ""  # why there is no worker, as last reported
        self._waits_for = ""  # missing data, as last reported
        bus.watch(keys.of_worker("*", "offer/**"), self._queued(self._notice))

    @property
    def lanes(self) -> int:
        """Number of lanes of all present workers."""
        return sum(worker.offer.lanes for worker in self.scheduler.workers.values())

    @property
    def frames(self) -> set[int]:
        """The frames of all unfinished refinements."""
        return {each.request.frame for each in self._refinements.values()}

    def begin(self, request: RefineRequest) -> Refinement:
        """Send all batches of a request; those of a spare request after all others."""
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
            self._inbox.get(timeout=self.scheduler.limits.tick_s)()

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
        self._next_poll = now + self.scheduler.limits.tick_s
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
            self._alone_since, self._alone_reported = None, ""
            raise NoWorkers(f"no worker joined within {limit:g} s; {self._advise()}")
        if alone > NOTICE_S and self._alone_reported != (why := self._explain()):
            self._alone_reported = why
            self._report(why)

    def _foreign(self) -> str:
        """The kinds of the present workers, if none is used."""
        kinds = {offer.kind for offers in self._offers.values() for offer in offers.values()}
        return " or ".join(sorted(kinds))

    def _explain(self) -> str:
        """Why there is no worker."""
        if self._pool.lanes:
            return "the local worker is not ready yet; the first time, compiling takes a few minutes"
        if foreign := self._foreign():
            missing = f"no worker of kind '{self._pool.kind}' is connected"
            return f"{missing}, and those of kind {foreign} are not used; {self._advise()}"
        return "no worker is connected; waiting for one"

    def _advise(self) -> str:
        """How to start a worker."""
        where = self._pool.listen or self._pool.connect or "ENDPOINT"
        if not (foreign := self._foreign()):
            return f"start gepf-worker --connect {where}"
        return f"start gepf-worker --kind {self._pool.kind} --connect {where}, or give --kind {foreign}"

    def _notice(self, key: str, alive: bool) -> None:
        """An offer of a worker has appeared or disappeared."""
        worker, now = keys.worker_of(key), time.monotonic()
        offers = self._offers.setdefault(worker, {})
        offers.pop(key, None)
        if alive:
            try:
                offers[key] = keys.read_offer(key)
            except ProtocolError as error:
                self._report(f"worker {worker} is not used: {error}")
        if not offers:
            del self._offers[worker]
        used = [offer for offer in offers.values() if offer.kind == self._pool.kind]
        if used:
            self._welcome(worker, used[-1])
            self._send(self.scheduler.join(worker, used[-1], now))
        elif worker in self._senders:
            self._senders.pop(worker).close()
            self._report(f"worker {worker} left")
            self._send(self.scheduler.leave(worker, now))

    def _welcome(self, worker: str, offer: Offer) -> None:
        """A worker that is used has joined, or offers something else."""
        if self.seen and offer.processor not in self.seen.values():
            earlier = ", ".join(sorted(set(self.seen.values())))
            self._report(
                f"worker {worker} has a different processor ({offer.processor}) from the workers before it "
                f"({earlier}); if this run is repeated, the last digits may differ"
            )
        self.seen[worker] = offer.processor
        if worker not in self._senders:
            refine = keys.of_worker(worker, self._refine)
            self._senders[worker] = self._bus.request_sender(refine, self.scheduler.limits.request_timeout_s)
            self._alone_since, self._alone_reported = None, ""
            self._report(f"worker {worker} joined")

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
        reason, waited = "", 0.0
        if worker == self._local.name and ending != "nothing":
            self._local.heard()
        if ending == "reply":
            outcome, reason, waited = self._receive(ticket, worker, payload)
        elif ending == "refusal":
            outcome, reason = read_refusal(payload)
            if outcome == "unavailable" and reason != self._waits_for:
                self._waits_for = reason
                self._report(f"worker {worker} waits: {reason}")
        try:
            self._send(self.scheduler.end(ticket, outcome, time.monotonic(), reason, waited))
        except SilentWorkers as error:
            timeout_s = self.scheduler.limits.request_timeout_s
            raise SilentWorkers(
                f"workers are connected, but none answers within {timeout_s:.0f} s (last {worker}): "
                "the connection is broken, they do not respond, or a request has too many particles or points"
            ) from error
        except ProtocolError as error:
            raise ProtocolError(f"no worker can refine the particles: {error}") from error

    def _receive(self, ticket: int, worker: str, payload: bytes) -> tuple[Outcome, str, float]:
        """Keep a useful reply, unless it is invalid; also returns how long the request waited for others."""
        batch = self.scheduler.wanted(ticket)
        if batch is None:
            return "refined", "", 0.0
        refinement = self._refinements[batch.refinement]
        asked = refinement.request.particles
        shape = batch.stop - batch.start, asked.poses.shape[1]
        try:
            part, waited = decode_refined(payload, shape, covariance=asked.covariance)
        except ProtocolError as error:
            self.malformed += 1
            self._report(f"worker {worker} sent an invalid reply: {error}")
            return "refused", f"invalid reply: {error}", 0.0
        refinement.parts[batch.start] = part
        return "refined", "", waited


def read_refusal(payload: bytes) -> tuple[Outcome, str]:
    """The outcome of a request that was refused, and the worker's reason; `nothing` if it is unreadable."""
    try:
        refusal = decode_refusal(payload)
    except VersionError as error:
        return "refused", f"{error}; install the same version of gepf on both sides"
    except ProtocolError:
        return "nothing", ""
    return "unavailable" if refusal.retryable else "refused", refusal.reason
