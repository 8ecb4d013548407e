"""The worker's loop: a request's bytes in, refine, the reply's bytes out; runs take turns.

What a worker remembers, frames and models, only saves it from asking again: a result depends on its
request alone.
"""

from __future__ import annotations

import logging
from collections import OrderedDict, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from common.body import BodyModel
from common.errors import BusError, ProtocolError
from common.frame import SubjectFrame
from common.protocol import keys
from common.protocol.frames import decode_frame
from common.protocol.messages import RefineRequest, decode_request, encode_refined, encode_refusal
from common.refinement import Refined
from common.settings import RefineSettings
from common.transport.bus import Bus
from common.transport.channels import IncomingRequest, RequestReceiver
from worker.activity import Activity
from worker.connection import DeadLink
from worker.memory import Contents, Memory, RunMemory

T = TypeVar("T")

MOST = 64  # requests that may wait


log = logging.getLogger(__name__)
O = TypeVar("O")  # noqa: E741 - what `observe` makes of a frame
O_contra = TypeVar("O_contra", contravariant=True)


class FairQueue(Generic[T]):
    """Requests in the order they came within a run, and round-robin between runs."""

    def __init__(self) -> None:
        self._waiting: OrderedDict[str, deque[T]] = OrderedDict()  # whose turn it is first

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def put(self, run: str, request: T) -> T | None:
        """Add a request; a run that had none waiting comes last. Returns the request dropped for it, if any.

        When too many wait, that is the oldest of the run that has most of them.
        """
        self._waiting.setdefault(run, deque()).append(request)
        if sum(map(len, self._waiting.values())) <= MOST:
            return None
        longest = max(self._waiting, key=lambda name: len(self._waiting[name]))
        oldest = self._waiting[longest].popleft()
        if not self._waiting[longest]:
            del self._waiting[longest]
        return oldest

    def take(self) -> T:
        """Remove the next request and return it; IndexError if none waits."""
        if not self._waiting:
            raise IndexError("no request waits")
        run, requests = self._waiting.popitem(last=False)
        request = requests.popleft()
        if requests:
            self._waiting[run] = requests
        return request

    def forget(self, run: str) -> list[T]:
        """Remove all requests of a run and return them."""
        return list(self._waiting.pop(run, ()))


class Refine(Protocol[O_contra]):
    """Refines poses (N, D), with their covariances where those are asked for."""

    def __call__(
        self,
        model: BodyModel,
        observation: O_contra,
        poses: NDArray[np.float64],
        settings: RefineSettings,
        /,
        *,
        covariance: bool = False,
    ) -> Refined:
        """What becomes of them, in the order given."""
        ...


def nothing(observation: object, settings: RefineSettings) -> None:
    """Prepare nothing."""


@dataclass(frozen=True, slots=True)
class Kernel(Generic[O]):
    """The functions that a worker computes with."""

    observe: Callable[[SubjectFrame], O]
    refine: Refine[O]
    lanes: int = 1  # particles that it refines at once
    prepare: Callable[[O, RefineSettings], None] = nothing  # what is observed, for a request to come


@dataclass(frozen=True, slots=True)
class Batch:
    """A request of the bus, and its decoded content."""

    request: IncomingRequest
    content: RefineRequest


class Service(Generic[O]):
    """One worker on the bus."""

    def __init__(self, bus: Bus, name: str, kernel: Kernel[O]) -> None:
        self._bus = bus
        self._name = name
        self._kernel = kernel
        self.activity = Activity(kernel.lanes)
        self._memory: Memory[O] = Memory()
        self._contents = Contents(bus, self._memory)
        self._queue: FairQueue[Batch] = FairQueue()
        self._ended_runs: SimpleQueue[str] = SimpleQueue()
        self._requests: RequestReceiver | None = None
        self._dead_link = DeadLink(bus)
        self._stopped = False
        self.abandoned = False  # nobody is at the other end: a new session is needed

    def run(self) -> None:
        """Announce the worker; serve until `stop` is called, the session ends or its link proves dead."""
        self._bus.follow_frames(keys.ANY_RUN_FRAMES, self._keep_frame)
        self._bus.watch(keys.ANY_RUN_ALIVE, self._notice_run)
        self._requests = self._bus.request_receiver(keys.worker_refine(self._name))
        self._bus.announce(keys.worker_lanes(self._name, self._kernel.lanes))
        self._bus.announce(keys.worker_alive(self._name))  # last: from now on there will be requests
        if self._stopped:
            return
        while (batch := self._next(self._requests)) is not None:
            with batch.request:
                self.serve(batch)

    def finish(self) -> None:
        """End `run` after the request at hand; may be called by a signal's handler, as it takes no lock."""
        self._stopped = True

    def stop(self) -> None:
        """End `run`; may be called from another thread."""
        self.finish()
        if self._requests is not None:
            self._requests.close()

    def _next(self, requests: RequestReceiver) -> Batch | None:
        """The next batch of the queue; None when there will be no more."""
        wait = False
        while self._goes_on() and (arrived := requests.receive(wait=wait)) is not None:
            for request in arrived:
                self._dead_link.hear()
                self._admit(request)
            self._drop_ended_runs()
            if self._queue:
                return self._queue.take()
            wait = not self._observe_ahead()
        return None

    def _goes_on(self) -> bool:
        """Whether there may be more requests."""
        self.abandoned = not self._stopped and self._dead_link.is_found()
        return not (self._stopped or self.abandoned)

    def _observe_ahead(self) -> bool:
        """Observe a frame that came before its requests; False if there is none."""
        unread = self._memory.take_unread()
        if unread is None:
            return False
        memory, number, payload = unread
        with suppress(Exception):  # its requests will report what is wrong with it
            observation = self._kernel.observe(decode_frame(payload))
            memory.observations.put(number, observation)
            if memory.settings is not None:
                self._kernel.prepare(observation, memory.settings)
        return True

    def _admit(self, request: IncomingRequest) -> None:
        """Queue a request, or refuse it if it cannot be decoded."""
        try:
            content = decode_request(request.payload)
        except ProtocolError as error:
            with request:
                refuse(request, str(error))
        else:
            dropped = self._queue.put(content.run, Batch(request, content))
            if dropped is not None:
                with dropped.request:
                    log.warning("dropped a request: too many wait")

    def _drop_ended_runs(self) -> None:
        """Drop the requests of runs that are gone: nobody waits for them."""
        while not self._ended_runs.empty():
            for batch in self._queue.forget(self._ended_runs.get()):
                with batch.request:
                    log.info("dropped a request: its run is gone")

    def serve(self, batch: Batch) -> None:
        """Reply to one batch, or refuse it with the reason."""
        try:
            payload = self.answer(batch.content)
        except BusError as error:
            refuse(batch.request, str(error), retryable=True)
        except ProtocolError as error:
            refuse(batch.request, str(error))
        except Exception as error:  # noqa: BLE001 - no request may end the worker
            refuse(batch.request, f"could not refine: {type(error).__name__}: {error}")
        else:
            batch.request.reply(payload)

    def answer(self, request: RefineRequest) -> bytes:
        """Refine a batch.

        Raises ProtocolError for a request that cannot be served, BusError if its frame or model is not found.
        """
        memory: RunMemory[O] = self._memory.of(request.run)
        model = self._contents.model(memory, request)
        observation = memory.observations.find(request.frame, lambda: self._observe(request))
        memory.settings = request.settings
        refined = self._kernel.refine(
            model, observation, request.poses, request.settings, covariance=request.covariance
        )
        self.activity.refined(request.run, len(request.poses))
        return encode_refined(refined)

    def _observe(self, request: RefineRequest) -> O:
        return self._kernel.observe(self._contents.frame(request))

    def _keep_frame(self, key: str, number: int, payload: bytes) -> None:
        """Store a published frame; called from a thread of the bus."""
        self._memory.put_frame(keys.run_of(key), number, payload)
        if self._requests is not None:
            self._requests.wake()

    def _notice_run(self, key: str, alive: bool) -> None:
        """Forget a run when its coordinator is gone; called from a thread of the bus."""
        run = keys.run_of(key)
        if not alive:
            self._memory.forget(run)
            self._ended_runs.put(run)


def refuse(request: IncomingRequest, reason: str, *, retryable: bool = False) -> None:
    """Refuse a request with a reason, which is also logged."""
    log.warning("refused a request: %s", reason)
    request.refuse(encode_refusal(reason, retryable=retryable))
