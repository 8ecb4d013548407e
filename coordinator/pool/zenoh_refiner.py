"""Carries the dispatch's instructions out on the bus; owns the clock and the local workers."""

from __future__ import annotations

import math
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.errors import ProtocolError
from common.frame import SubjectFrame
from common.protocol import keys
from common.protocol.messages import (
    RefineRequest,
    decode_refined,
    decode_refusal,
    encode_request,
)
from common.refinement import Refined, concatenate, unanswered
from common.settings import RefineSettings
from common.transport.bus import open_coordinator
from coordinator.pool.events import (
    Accept,
    Done,
    Ended,
    Event,
    Fail,
    Instruction,
    JobStarted,
    Refused,
    Replied,
    Send,
    Ticked,
    Unavailable,
    WorkerJoined,
    WorkerLeft,
)
from coordinator.pool.local_workers import LocalWorkers
from coordinator.pool.membership import Members
from coordinator.pool.options import Pool, absence
from coordinator.pool.publication import Publication
from coordinator.pool.scheduler import Dispatch
from coordinator.pool.statistics import PoolStatistics
from coordinator.tracking.refiner import idle

TICK = 0.1  # seconds between looks at the clock and at the local workers
LONGEST_FOLDER = 80  # characters; the path of a socket has at most 107


@dataclass(frozen=True, slots=True)
class Reply:
    """A request has been answered; from a thread of the bus."""

    ticket: int
    payload: bytes
    at: float  # when, by the monotonic clock


class ZenohRefiner:
    """Has particles refined by whatever workers there are; a context manager.

    Results come in the order of the particles and do not depend on who made them. `tell` is called with
    a line for people when workers come, go, or are missing.
    """

    def __init__(self, pool: Pool, tell: Callable[[str], None] = lambda _: None) -> None:
        self.run = keys.check_name("run", pool.run or uuid.uuid4().hex[:12])
        self._pool = pool
        self._tell = tell
        self._stack = ExitStack()
        self._inbox: SimpleQueue[Event | Reply] = SimpleQueue()
        self._dispatch = Dispatch()
        self._statistics = PoolStatistics()
        self._request: RefineRequest | None = None
        self._refined: dict[int, Refined] = {}  # by ticket
        self._parts: dict[int, Refined] = {}  # by first particle
        self._done = False
        self._due = math.inf  # when the frame must do with the particles that are answered
        self._next_look = 0.0
        self._hindrance = ""  # told last

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(private_folder()))
            local = f"unixsock-stream/{folder / 'bus'}"
            pool = self._pool
            own = [local] if pool.workers_started else []
            self._bus = stack.enter_context(
                open_coordinator([*own, *pool.listen_endpoints], pool.connect_endpoints, pool.security)
            )
            self._publication = Publication(self._bus, self.run)
            self._bus.announce(keys.run_alive(self.run))
            self._bus.watch(keys.ANY_WORKER_ALIVE, self._notice)
            names = [f"{self.run}-{k}" for k in range(pool.workers_started)]
            ours = LocalWorkers(names, local, folder, self._pool.worker_command)
            stack.callback(ours.stop)
            self._members = Members(self._bus, ours, absence(self._pool), self._tell)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def statistics(self) -> PoolStatistics:
        """What has gone over the bus so far."""
        counts = self._dispatch.counts
        self._statistics.workers_seen = self._members.seen
        self._statistics.local_workers_restarted = self._members.local.restarted
        self._statistics.batches_sent = counts.batches_sent
        self._statistics.batches_sent_again = counts.batches_sent_again
        self._statistics.batches_refused = counts.batches_refused
        return self._statistics

    @property
    def local_pids(self) -> dict[str, int]:
        """Process ids of our own workers by name."""
        return {worker.name: worker.process.pid for worker in self._members.local.workers.values()}

    def wait_for(self, workers: int) -> None:
        """Wait until so many workers are there. Raises as `refine` does."""
        while len(self._members) < workers:
            self._step()

    def listen(self, key: str, on_message: Callable[[bytes], None]) -> None:
        """Have `on_message(payload)` called, on a thread of the bus, for what others publish."""
        self._bus.subscribe(key, on_message)

    def publish(self, subject: SubjectFrame) -> None:
        """Send a frame to all workers; all later calls of `refine` are about it."""
        with self._timed("publish"):
            self._publication.put(subject)
            if self._pool.deadline is not None:
                self._due = time.monotonic() + self._pool.deadline

    def send_ahead(self, subject: SubjectFrame) -> None:
        """Send the frame that is to be published next, so that workers have it in time."""
        self._publication.put_ahead(subject)

    def refine(
        self,
        model: BodyModel,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        meanwhile: Callable[[], None] = idle,
    ) -> Refined:
        """Poses (N, D) after their descent, in the order given; `meanwhile` is called when all are sent.

        When the frame is due, those that are not answered yet are left out; the first answer is waited for.
        Raises NoWorkers when the wait for a worker is over, ProtocolError when no worker can serve the
        request, BusError when the transport fails or local workers do not start.
        """
        if len(poses) == 0:
            raise ValueError("there is nothing to refine")
        with self._timed("refine"):
            self._publication.offer(model)
            if self._dispatch.batches:
                self._handle(JobStarted(0))  # gives up what is left of a job that failed
            self._catch_up()
            self._request = RefineRequest(self.run, self._publication.current, model.hash, settings, poses)
            self._parts.clear()
            self._refined.clear()
            self._done = False
            self._handle(JobStarted(len(poses)))
            meanwhile()
            self._catch_up()  # what is there already is in time, however long that took
            while not self._done and not (self._parts and time.monotonic() >= self._due):
                self._step()
            return self._gather(poses)

    def _gather(self, poses: NDArray[np.float64]) -> Refined:
        """What has been answered, in the order of the particles, and NaN for the rest."""
        parts: list[Refined] = []
        stop = 0
        for start, part in [*sorted(self._parts.items()), (len(poses), None)]:
            if start > stop:
                parts.append(unanswered(start - stop, part or parts[-1]))
            if part is not None:
                parts.append(part)
                stop = start + len(part.poses)
        return concatenate(parts)

    def _notice(self, key: str, alive: bool) -> None:
        worker = keys.worker_of(key)
        self._inbox.put(WorkerJoined(worker) if alive else WorkerLeft(worker))

    def _catch_up(self) -> None:
        """Handle what has happened since the last job."""
        while not self._inbox.empty():
            self._handle(self._interpret(self._inbox.get()))

    def _step(self) -> None:
        """Handle what happens next, and look at the clock and the workers now and then."""
        if time.monotonic() >= self._next_look:
            self._next_look = time.monotonic() + TICK
            self._members.look(time.monotonic())
            self._handle(Ticked())
            return
        with suppress(Empty):
            self._handle(self._interpret(self._inbox.get(timeout=self._patience())))

    def _patience(self) -> float:
        """Seconds until there is something to do even if nothing happens."""
        due = self._due - time.monotonic()
        return min(TICK, due) if due > 0 else TICK

    def _interpret(self, arrival: Event | Reply) -> Event:
        match arrival:
            case Reply():
                return self._read(arrival)
            case Unavailable(ticket, reason):
                self._tell_of_hindrance(ticket, reason)
            case WorkerJoined(worker):
                self._members.welcome(worker)
            case WorkerLeft(worker):
                self._members.dismiss(worker)
        return arrival

    def _read(self, reply: Reply) -> Event:
        ticket, read = reply.ticket, Replied(reply.ticket, reply.at)
        flight = self._dispatch.flights.get(ticket)
        if flight is None or self._request is None or not self._dispatch.is_current(ticket):
            return read
        asked = (flight.batch.stop - flight.batch.start, self._request.poses.shape[1])
        try:
            self._refined[ticket] = decode_refined(reply.payload, asked)
        except ProtocolError as error:
            self._statistics.replies_malformed += 1
            self._tell(f"worker {flight.worker.name} sent a reply that makes no sense: {error}")
            return Refused(ticket, f"a reply made no sense: {error}")
        return read

    def _tell_of_hindrance(self, ticket: int, reason: str) -> None:
        flight = self._dispatch.flights.get(ticket)
        if flight is not None and reason != self._hindrance:
            self._hindrance = reason
            self._tell(f"worker {flight.worker.name} waits: {reason}")

    def _handle(self, event: Event) -> None:
        for instruction in self._dispatch.handle(event, time.monotonic()):
            self._carry_out(instruction)

    def _carry_out(self, instruction: Instruction) -> None:
        match instruction:
            case Send():
                self._send(instruction)
            case Accept(ticket, start):
                self._parts[start] = self._refined.pop(ticket)
            case Done():
                self._done = True
            case Fail(reason):
                raise ProtocolError(f"no worker can refine frame {self._publication.current}: {reason}")

    def _send(self, send: Send) -> None:
        assert self._request is not None
        request = self._request
        batch = RefineRequest(
            request.run,
            request.frame,
            request.model_hash,
            request.settings,
            request.poses[send.start : send.stop],
        )
        self._members.asker(send.worker).ask(
            encode_request(batch),
            on_reply=lambda payload: self._inbox.put(Reply(send.ticket, payload, time.monotonic())),
            on_refusal=lambda payload: self._inbox.put(read_refusal(send.ticket, payload)),
            on_end=lambda: self._inbox.put(Ended(send.ticket)),
        )

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self._statistics.stage_seconds[stage] += time.perf_counter() - began


def read_refusal(ticket: int, payload: bytes) -> Event:
    """A worker's reason, or the end of a request of which the bus itself knows no more."""
    try:
        refusal = decode_refusal(payload)
    except ProtocolError:
        return Ended(ticket)
    return (Unavailable if refusal.retryable else Refused)(ticket, refusal.reason)


def private_folder() -> tempfile.TemporaryDirectory[str]:
    """A folder of our own whose path is short enough for a socket in it."""
    usual = len(tempfile.gettempdir()) <= LONGEST_FOLDER
    return tempfile.TemporaryDirectory(prefix="gepf-", dir=None if usual else "/tmp")
