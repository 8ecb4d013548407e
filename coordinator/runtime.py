"""Carries the dispatch's instructions out on the bus; owns the clock and the local workers."""

from __future__ import annotations

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

from common import keys
from common.body import BodyModel
from common.bus import Asker, Bus, FramePublisher, open_coordinator
from common.errors import NoWorkers, ProtocolError
from common.frame import SubjectFrame
from common.messages import (
    RefineRequest,
    decode_refined,
    decode_refusal,
    encode_frame,
    encode_model,
    encode_request,
)
from common.refinement import Refined, concatenate
from common.settings import RefineSettings
from coordinator.dispatch import (
    Accept,
    Dispatch,
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
    WorkerJoined,
    WorkerLeft,
)
from coordinator.local_workers import COMMAND, LocalWorkers
from coordinator.shelf import Shelf
from coordinator.traffic import Traffic

TICK = 0.1  # seconds between looks at the clock and at the local workers
REQUEST_TIMEOUT = 30.0  # seconds; only a worker that lives and hangs takes so long
NOTICE = 5.0  # seconds without a worker until we say so
LONGEST_FOLDER = 80  # characters; the path of a socket has at most 107
NOT_READY = "the local workers are not ready yet; the first time, they compile their kernels for a minute"


@dataclass(frozen=True, slots=True)
class PoolOptions:
    """Who may refine: workers of our own, and those that connect or are found behind a router."""

    local_workers: int = 0
    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    worker_timeout: float | None = None  # seconds without any worker until we give up; None to wait for ever
    run: str | None = None  # None to invent a name
    worker_command: tuple[str, ...] = COMMAND


@dataclass(frozen=True, slots=True)
class Reply:
    """A request has been answered; from a thread of the bus."""

    ticket: int
    payload: bytes


@dataclass(frozen=True, slots=True)
class Refusal:
    """A request has brought an error; from a thread of the bus."""

    ticket: int
    payload: bytes


class ZenohRefiner:
    """Has particles refined by whatever workers there are; a context manager.

    Results come in the order of the particles and do not depend on who made them. `tell` is called with
    a line for people when workers come, go, or are missing.
    """

    def __init__(self, options: PoolOptions, tell: Callable[[str], None] = lambda _: None) -> None:
        self.run = keys.check_name("run", options.run or uuid.uuid4().hex[:12])
        self._options = options
        self._tell = tell
        self._stack = ExitStack()
        self._inbox: SimpleQueue[Event | Reply | Refusal] = SimpleQueue()
        self._dispatch = Dispatch()
        self._askers: dict[str, Asker] = {}
        self._seen: dict[str, None] = {}
        self._shelf = Shelf()
        self._traffic = Traffic()
        self._alone_since: float | None = None
        self._told_alone = False
        self._frame = -1
        self._request: RefineRequest | None = None
        self._refined: dict[int, Refined] = {}  # by ticket
        self._parts: dict[int, Refined] = {}  # by first particle
        self._done = False
        self._next_look = 0.0

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            folder = Path(stack.enter_context(private_folder()))
            local = f"unixsock-stream/{folder / 'bus'}"
            own = [local] if self._options.local_workers else []
            self._bus = stack.enter_context(
                open_coordinator([*own, *self._options.listen], self._options.connect)
            )
            self._frames = self._open(self._bus)
            names = [f"{self.run}-{k}" for k in range(self._options.local_workers)]
            self._local = LocalWorkers(names, local, folder, self._options.worker_command)
            stack.callback(self._local.stop)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    @property
    def traffic(self) -> Traffic:
        """What has gone over the bus so far."""
        counts = self._dispatch.counts
        self._traffic.workers_seen = tuple(sorted(self._seen))
        self._traffic.local_workers_restarted = self._local.restarted
        self._traffic.batches_sent = counts.batches_sent
        self._traffic.batches_sent_again = counts.batches_sent_again
        self._traffic.batches_refused = counts.batches_refused
        return self._traffic

    @property
    def local_pids(self) -> dict[str, int]:
        """Process ids of our own workers by name."""
        return {worker.name: worker.process.pid for worker in self._local.workers.values()}

    def wait_for(self, workers: int) -> None:
        """Wait until so many workers are there. Raises as `refine` does."""
        while len(self._askers) < workers:
            self._step()

    def publish(self, subject: SubjectFrame) -> None:
        """Send a frame to all workers; all later calls of `refine` are about it."""
        with self._timed("publish"):
            self._frame = max(subject.frame.number, self._frame + 1)  # never the same twice
            payload = encode_frame(subject)
            self._shelf.put_frame(self._frame, payload)
            self._frames.put(self._frame, payload)

    def refine(self, model: BodyModel, poses: NDArray[np.float64], settings: RefineSettings) -> Refined:
        """Poses (N, D) after their descent, in the order given.

        Raises NoWorkers when the wait for a worker is over, ProtocolError when no worker can serve the
        request, BusError when the transport fails or local workers do not start.
        """
        if len(poses) == 0:
            raise ValueError("there is nothing to refine")
        with self._timed("refine"):
            self._shelf.put_model(model.hash, lambda: encode_model(model))
            self._request = RefineRequest(self.run, self._frame, model.hash, settings, poses)
            self._parts.clear()
            self._refined.clear()
            self._done = False
            self._catch_up()
            self._handle(JobStarted(len(poses)))
            while not self._done:
                self._step()
            return concatenate([self._parts[start] for start in sorted(self._parts)])

    def _open(self, bus: Bus) -> FramePublisher:
        bus.serve(keys.run_frame(self.run, "*"), lambda key: self._shelf.frame(keys.last_of(key)))
        bus.serve(keys.run_model(self.run, "*"), lambda key: self._shelf.model(keys.last_of(key)))
        bus.watch(keys.ANY_WORKER_ALIVE, self._notice)
        return bus.publish_frames(keys.run_frames(self.run))

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
            self._look_after_workers()
            self._handle(Ticked())
            return
        with suppress(Empty):
            self._handle(self._interpret(self._inbox.get(timeout=TICK)))

    def _interpret(self, arrival: Event | Reply | Refusal) -> Event:
        match arrival:
            case Reply(ticket, payload):
                return self._read_reply(ticket, payload)
            case Refusal(ticket, payload):
                return read_refusal(ticket, payload)
            case WorkerJoined(worker):
                self._welcome(worker)
            case WorkerLeft(worker):
                self._dismiss(worker)
        return arrival

    def _read_reply(self, ticket: int, payload: bytes) -> Event:
        flight = self._dispatch.flights.get(ticket)
        if flight is None or self._request is None or not self._dispatch.is_current(ticket):
            return Replied(ticket)
        asked = (flight.batch.stop - flight.batch.start, self._request.poses.shape[1])
        try:
            self._refined[ticket] = decode_refined(payload, asked)
        except ProtocolError as error:
            self._traffic.replies_malformed += 1
            self._tell(f"worker {flight.worker.name} sent a reply that makes no sense: {error}")
            return Refused(ticket, f"a reply made no sense: {error}")
        return Replied(ticket)

    def _welcome(self, worker: str) -> None:
        self._local.mark_serving(worker)
        if worker in self._askers:
            return
        self._askers[worker] = self._bus.asker(keys.worker_refine(worker), REQUEST_TIMEOUT)
        self._seen[worker] = None
        self._alone_since, self._told_alone = None, False
        self._tell(f"worker {worker} joined")

    def _dismiss(self, worker: str) -> None:
        asker = self._askers.pop(worker, None)
        if asker is not None:
            asker.close()
            self._tell(f"worker {worker} left")

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
                raise ProtocolError(f"no worker can refine frame {self._frame}: {reason}")

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
        self._askers[send.worker].ask(
            encode_request(batch),
            on_reply=lambda payload: self._inbox.put(Reply(send.ticket, payload)),
            on_refusal=lambda payload: self._inbox.put(Refusal(send.ticket, payload)),
            on_end=lambda: self._inbox.put(Ended(send.ticket)),
        )

    def _look_after_workers(self) -> None:
        for line in self._local.restart_dead():
            self._tell(line)
        if not self._askers:
            self._wait_alone(time.monotonic())

    def _wait_alone(self, now: float) -> None:
        """Nobody is there: say so after a while, and give up when the user wants that."""
        self._alone_since = now if self._alone_since is None else self._alone_since
        alone = now - self._alone_since
        timeout = self._options.worker_timeout
        if timeout is not None and alone > timeout:
            self._alone_since = None
            raise NoWorkers(f"no worker came within {timeout:g} s; start one with {self._invitation()}")
        if alone > NOTICE and not self._told_alone:
            self._told_alone = True
            self._tell(NOT_READY if self._options.local_workers else "no worker is there; waiting for one")

    def _invitation(self) -> str:
        endpoints = [*self._options.listen, *self._options.connect] or ["ENDPOINT"]
        return f"gepf-worker --connect {endpoints[0]}"

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        began = time.perf_counter()
        try:
            yield
        finally:
            self._traffic.stage_seconds[stage] += time.perf_counter() - began


def read_refusal(ticket: int, payload: bytes) -> Event:
    """A worker's reason, or the end of a request of which the bus itself knows no more."""
    try:
        return Refused(ticket, decode_refusal(payload))
    except ProtocolError:
        return Ended(ticket)


def private_folder() -> tempfile.TemporaryDirectory[str]:
    """A folder of our own whose path is short enough for a socket in it."""
    usual = len(tempfile.gettempdir()) <= LONGEST_FOLDER
    return tempfile.TemporaryDirectory(prefix="gepf-", dir=None if usual else "/tmp")
