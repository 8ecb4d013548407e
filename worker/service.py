"""The worker's loop: a request's bytes in, refine, the reply's bytes out.

Frames and models are cached only to avoid fetching them again: a result depends only on its request. Each
coordinator has only a few requests at a worker, so several coordinators are served alternately. Spare
requests, those of searches, are served beside the others, one per lane, on threads of low priority.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, Queue
from typing import Any, NamedTuple

from gepf.common.body import BodyModel
from gepf.common.errors import BusError, ProtocolError
from gepf.common.frame import SubjectFrame
from gepf.common.protocol import keys
from gepf.common.protocol.frames import number_of
from gepf.common.protocol.messages import RefineRequest, decode_request, encode_refined, encode_refusal
from gepf.common.refinement import Particles, Refined
from gepf.common.settings import RefineSettings
from gepf.common.transport.bus import Bus
from gepf.common.transport.channels import IncomingRequest
from gepf.worker.memory import Memory

LOOK_S = 0.2  # between checks for the end, if no signal interrupts the wait for a request
SILENCE_S = 10.0  # without a request before the coordinator is checked

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Kernel:
    """The compute functions of a worker.

    observe: converts a frame to an observation, prepared for requests with the settings.
    refine: refines particles of a body on an observation, and returns them in the same order. One thread
    calls it for requests, and several others for spare ones.
    lanes: number of particles that are refined in parallel.
    """

    observe: Callable[[SubjectFrame, RefineSettings], Any]
    refine: Callable[[BodyModel, Any, Particles], Refined]
    lanes: int = 1


class Task(NamedTuple):
    """Something to do for a run."""

    run: str
    do: Callable[[], None]


class Service:
    """One worker on the bus."""

    def __init__(self, bus: Bus, name: str, kernel: Kernel) -> None:
        self._bus = bus
        self._name = name
        self._kernel = kernel
        self._memory = Memory(bus, kernel.observe)
        self._tasks: Queue[Task] = Queue()
        self._spare_tasks: Queue[Task] = Queue()
        self._asks_at = time.monotonic() + SILENCE_S
        self._stopped = False
        self.abandoned = False  # the link is dead: a new session is needed

    def run(self) -> None:
        """Announce the worker; serve until `stop` is called or its link is dead."""
        self._bus.subscribe(keys.of_run("*", "frame"), self._keep_frame)
        self._bus.watch(keys.of_run("*", "alive"), self._notice_run)
        self._bus.serve_requests(keys.of_worker(self._name, "refine"), self._accept)
        self._bus.announce(keys.of_worker(self._name, f"lanes/{self._kernel.lanes}"))
        self._bus.announce(keys.of_worker(self._name, "alive"))  # last, as requests follow
        with ThreadPoolExecutor(self._kernel.lanes) as threads:
            spare = [threads.submit(self._serve_spare) for _ in range(self._kernel.lanes)]
            try:
                while not (self._stopped or self.abandoned or any(each.done() for each in spare)):
                    try:
                        self._tasks.get(timeout=LOOK_S).do()
                    except Empty:
                        self.abandoned = self._is_link_dead()
            finally:
                self.stop()  # the other threads, too
            for each in spare:
                each.result()  # raises its error

    def _serve_spare(self) -> None:
        """Serve spare requests until `run` ends."""
        if sys.platform == "linux":  # elsewhere, a priority is that of the process
            # a tenth of each core if others want all of it
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 10)
        while not self._stopped:
            with suppress(Empty):
                self._spare_tasks.get(timeout=LOOK_S).do()

    def stop(self) -> None:
        """End `run` after the present request; callable from another thread or a signal handler."""
        self._stopped = True

    def serve(self, request: IncomingRequest, asked: RefineRequest) -> None:
        """Reply to a waiting request, or refuse it with the reason."""
        self._asks_at = time.monotonic() + SILENCE_S
        with request:
            try:
                payload = self.answer(asked)
            except BusError as error:
                refuse(request, str(error), retryable=True)
            except ProtocolError as error:
                refuse(request, str(error))
            except Exception as error:  # noqa: BLE001 - no request may end the worker
                refuse(request, f"could not refine: {type(error).__name__}: {error}")
            else:
                request.reply(payload)

    def answer(self, request: RefineRequest) -> bytes:
        """Refine a batch.

        Raises ProtocolError for an invalid request, BusError if its frame or model is not found.
        """
        model, observation = self._memory.model(request), self._memory.observation(request)
        refined = self._kernel.refine(model, observation, request.particles)
        if not request.particles.spare:
            self._tasks.put(Task(request.run, partial(self._observe_ahead, request.run)))
        return encode_refined(refined)

    def _accept(self, request: IncomingRequest) -> None:
        """Queue a request; called on a thread of the bus."""
        try:
            asked = decode_request(request.payload)
        except ProtocolError as error:
            with request:
                refuse(request, str(error))
        else:
            tasks = self._spare_tasks if asked.particles.spare else self._tasks
            tasks.put(Task(asked.run, partial(self.serve, request, asked)))

    def _keep_frame(self, key: str, payload: bytes) -> None:
        """Keep a published frame, to be observed before its requests; called on a thread of the bus."""
        run = keys.owner_of(key)
        with suppress(ProtocolError):  # its requests report the error
            self._memory.put_frame(run, number_of(payload), payload)
            self._tasks.put(Task(run, partial(self._observe_ahead, run)))

    def _observe_ahead(self, run: str) -> None:
        with suppress(Exception):  # as above
            self._memory.observe_ahead(run)

    def _notice_run(self, key: str, alive: bool) -> None:
        """Drop a run and its requests when its coordinator has left; called on a thread of the bus."""
        if not alive:
            run = keys.owner_of(key)
            for tasks in (self._tasks, self._spare_tasks):
                with tasks.mutex:
                    tasks.queue = deque(task for task in tasks.queue if task.run != run)
            self._memory.forget(run)

    def _is_link_dead(self) -> bool:
        """Whether the link leads to a coordinator, but no run there answers.

        If a coordinator closes at the moment when a worker connects, the link may stay open as long as the
        process of the coordinator lives. The bus regards it as valid and never connects to the next
        coordinator.
        """
        if time.monotonic() < self._asks_at:
            return False
        self._asks_at = time.monotonic() + SILENCE_S
        with suppress(BusError):
            present = keys.of_run("*", "present")
            return self._bus.meets_coordinator() and self._bus.fetch(present) is None
        return True


def refuse(request: IncomingRequest, reason: str, *, retryable: bool = False) -> None:
    """Refuse a request with a reason, which is also logged."""
    log.warning("refused a request: %s", reason)
    request.refuse(encode_refusal(reason, retryable=retryable))
