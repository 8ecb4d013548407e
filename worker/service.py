"""The worker's loop: receive a request, refine its particles, send the reply.

Frames and models are cached only to avoid fetching them again: a result depends only on its request. Runs are
served in fair turns, see `gepf.worker.turns`; a large request takes several turns if there are other runs.
Spare requests, those of searches, are served beside the turns, one per lane, on threads of low priority.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace

from gepf.common.errors import BusError, ProtocolError
from gepf.common.kernel import Kernel
from gepf.common.protocol import keys
from gepf.common.protocol.messages import RefineRequest, decode_request, encode_refined, encode_refusal
from gepf.common.refinement import Refined, concatenate
from gepf.common.transport.bus import Bus
from gepf.common.transport.channels import IncomingRequest
from gepf.worker.memory import Memory
from gepf.worker.turns import Turns

LOOK_S = 0.2  # between checks for the end, if no signal interrupts the wait for a request
SILENCE_S = 10.0  # without a request before the coordinator is checked
PARTICLES_A_TURN = 4  # of a lane, if there are other runs: 10 to 30 ms on a processor
MOST_WAITING = 64  # requests of a run, and as many for each lane; a coordinator sends far fewer

log = logging.getLogger(__name__)


@dataclass(slots=True, eq=False)
class Task:
    """A request, and what is done of it so far. Without a request: observe the newest frame of the run."""

    asked: RefineRequest | None = None
    request: IncomingRequest | None = None
    arrived_at: float = 0.0
    served_s: float = 0.0
    parts: list[Refined] = field(default_factory=list)

    @property
    def done(self) -> int:
        """Number of refined particles."""
        return sum(len(part.poses) for part in self.parts)


class Service:
    """One worker on the bus."""

    def __init__(self, bus: Bus, name: str, kernel: Kernel) -> None:
        self._bus = bus
        self._name = name
        self._kernel = kernel
        self._memory = Memory(bus, kernel.observe, self._notice_frame)
        self._turns = Turns[Task]()
        lock = threading.Lock()  # of the turns
        self._urgent, self._spare = threading.Condition(lock), threading.Condition(lock)
        self._asks_at = time.monotonic() + SILENCE_S
        self._stopped = False
        self.abandoned = False  # the link is dead: a new session is needed

    def run(self) -> None:
        """Announce the worker; serve until `stop` is called or its link is dead."""
        self._bus.watch(keys.of_run(keys.ANY_RUN, "alive"), self._notice_run)
        self._bus.serve_requests(keys.of_worker(self._name, "refine/*"), self._accept)
        self._bus.announce(keys.offer_key(self._name, self._kernel.offer))  # last, as requests follow
        lanes = self._kernel.offer.lanes
        with ThreadPoolExecutor(lanes) as threads:
            spare = [threads.submit(self._serve_spare) for _ in range(lanes)]
            try:
                while not (self._stopped or self.abandoned or any(thread.done() for thread in spare)):
                    self._memory.unsubscribe()
                    if not self._take_turn():
                        self.abandoned = self._is_link_dead()
            finally:
                self.stop()  # the other threads, too
            for thread in spare:
                thread.result()  # raises its error

    def stop(self) -> None:
        """End `run` after the present request; callable from another thread or a signal handler."""
        self._stopped = True

    def answer(self, asked: RefineRequest) -> Refined:
        """Refine particles of a request.

        Raises ProtocolError for an invalid request, BusError if its frame or model is not found.
        """
        model, observation = self._memory.model(asked), self._memory.observation(asked)
        return self._kernel.refine(model, observation, asked.particles)

    def serve(self, run: str, task: Task, most: int | None = None, *, spare: bool = False) -> None:
        """Refine the next particles of a request, `most` or all; reply when all are done, or refuse it."""
        asked, request, began = task.asked, task.request, time.monotonic()
        if asked is None or request is None:
            with suppress(Exception):  # its requests report the error
                self._memory.observe_ahead(run)
            return
        self._asks_at = began + SILENCE_S
        try:
            first, count = task.done, len(asked.particles.poses)
            particles = asked.particles.part(first, count if most is None else min(first + most, count))
            task.parts.append(self.answer(replace(asked, particles=replace(particles, spare=spare))))
            task.served_s += time.monotonic() - began
            if task.done < count:
                self._put(run, task, first=True)
                return
            waited_s = time.monotonic() - task.arrived_at - task.served_s
            request.reply(encode_refined(concatenate(task.parts), max(0.0, waited_s)))
            if not asked.particles.spare:
                self._put(run, Task())
        except BusError as error:
            refuse(request, str(error), retryable=True)
        except ProtocolError as error:
            refuse(request, str(error))
        except Exception as error:  # noqa: BLE001 - no request may end the worker
            refuse(request, f"could not refine: {type(error).__name__}: {error}")
        except BaseException:
            request.close()
            raise
        request.close()

    def _take_turn(self) -> bool:
        """Do the work whose turn it is; False if there was none for a while."""
        with self._urgent:
            taken = self._turns.take()
            if taken is None:
                self._urgent.wait(LOOK_S)
                taken = self._turns.take()
            if taken is None:
                return False
            run, task = taken
            most = None if self._turns.is_alone(run) else PARTICLES_A_TURN * self._kernel.offer.slots
        began = time.monotonic()
        self.serve(run, task, most)
        with self._urgent:
            self._turns.charge(run, time.monotonic() - began)
        return True

    def _serve_spare(self) -> None:
        """Serve spare requests until `run` ends."""
        if sys.platform == "linux":  # elsewhere, a priority is that of the whole process
            # a tenth of each core if others want all of it
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 10)
        while not self._stopped:
            with self._spare:
                taken = self._turns.take_spare()
                if taken is None:
                    self._spare.wait(LOOK_S)
                    continue
                run, task = taken
                most = None if self._turns.is_alone(run) else PARTICLES_A_TURN * self._kernel.offer.batch
            began, worked = time.monotonic(), time.thread_time()
            self.serve(run, task, most, spare=True)
            worked = (time.thread_time() - worked) / self._kernel.offer.lanes
            with self._spare:
                self._turns.charge(run, worked, beside=time.monotonic() - began)

    def _accept(self, request: IncomingRequest) -> None:
        """Queue a request; called on a thread of the bus."""
        try:
            asked = self._admitted(request)
        except ProtocolError as error:
            with request:
                refuse(request, str(error))
        except Exception as error:  # noqa: BLE001 - a request without an answer would be waited for
            with request:
                refuse(request, f"could not read the request: {type(error).__name__}: {error}")
        else:
            self._put(asked.run, Task(asked, request, time.monotonic()))

    def _admitted(self, request: IncomingRequest) -> RefineRequest:
        """A request; ProtocolError if it is invalid, for a run of another coordinator, or one too many."""
        asked, coordinator = decode_request(request.payload), keys.last_of(request.key)
        if keys.coordinator_of(asked.run) != coordinator:
            raise ProtocolError(f"run {asked.run} does not belong to {coordinator}")
        if self._is_full(asked.run):
            raise ProtocolError(f"too many requests of run {asked.run} are waiting")
        return asked

    def _put(self, run: str, task: Task, *, first: bool = False) -> None:
        """Queue a task; `first` puts it ahead of the others of its run, because it was begun."""
        spare = task.asked is not None and task.asked.particles.spare
        changed = self._spare if spare else self._urgent
        with changed:
            self._turns.put(run, task, spare=spare, first=first)
            changed.notify()

    def _is_full(self, run: str) -> bool:
        """Whether so many tasks of a run are waiting that no more are accepted."""
        return self._turns.count(run) >= MOST_WAITING * (1 + self._kernel.offer.lanes)

    def _notice_frame(self, run: str) -> None:
        """Have a published frame observed before requests for it arrive; called on a thread of the bus."""
        if not self._is_full(run):
            self._put(run, Task())

    def _notice_run(self, key: str, alive: bool) -> None:
        """Drop a run and its requests when its coordinator has left; called on a thread of the bus."""
        if not alive:
            run = keys.run_of(key)
            with self._urgent:
                dropped = self._turns.drop(run)
            for task in dropped:
                if task.request is not None:
                    task.request.close()
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
            present = keys.of_run(keys.ANY_RUN, "present")
            return self._bus.meets_coordinator() and self._bus.fetch(present) is None
        return True


def refuse(request: IncomingRequest, reason: str, *, retryable: bool = False) -> None:
    """Refuse a request with a reason, which is also logged."""
    log.warning("refused a request: %s", reason)
    request.refuse(encode_refusal(reason, retryable=retryable))
