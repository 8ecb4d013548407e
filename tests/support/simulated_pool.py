"""A pool in simulated time: real schedulers and turns, and workers that take a known time for a particle."""

from __future__ import annotations

import heapq
import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count

from gepf.common.offer import Offer
from gepf.coordinator.pool.scheduler import LIMITS, Batch, Request, Scheduler, Worker
from gepf.worker.service import PARTICLES_A_TURN
from gepf.worker.turns import Turns

LINK_S = 0.0005  # from a coordinator to a worker, or back


class Clock:
    """Events in the order of their times."""

    def __init__(self) -> None:
        self.now = 0.0
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._numbers = count()

    def after(self, seconds: float, do: Callable[[], None]) -> None:
        """Do something later."""
        heapq.heappush(self._events, (self.now + seconds, next(self._numbers), do))

    def run(self, until: float) -> None:
        """Let the time pass."""
        while self._events and self._events[0][0] <= until:
            self.now, _, do = heapq.heappop(self._events)
            do()
        self.now = until


@dataclass(eq=False)
class Job:
    """A request at a worker."""

    request: Request
    arrived: float
    end: Callable[[float], None]  # called with the time that it has waited for others
    done: int = 0
    served: float = 0.0


@dataclass(eq=False)
class SimulatedWorker:
    """A worker that serves as `gepf.worker.service.Service`, without threads for searches."""

    clock: Clock
    offer: Offer
    particle_s: float
    turns: Turns[Job] = field(default_factory=Turns)
    served: dict[str, float] = field(default_factory=dict)  # seconds by run
    busy: bool = False
    gone: bool = False

    def receive(self, run: str, job: Job) -> None:
        """A request arrives."""
        if not self.gone:
            self.turns.put(run, job)
            self._next()

    def flood(self, run: str, requests: int, particles: int) -> None:
        """A run that keeps many large requests waiting here, whatever a coordinator may do."""
        asked = Request(0, Worker("", self.offer), Batch(0, False, 0, particles), 0.0)
        for _ in range(requests):
            self.receive(run, Job(asked, self.clock.now, lambda _: self.flood(run, 1, particles)))

    def _next(self) -> None:
        taken = None if self.busy else self.turns.take()
        if taken is None:
            return
        (run, job), self.busy = taken, True
        left = job.request.batch.stop - job.request.batch.start - job.done
        most = left if self.turns.is_alone(run) else PARTICLES_A_TURN * self.offer.slots
        seconds = math.ceil(min(left, most) / self.offer.slots) * self.particle_s
        self.clock.after(seconds, lambda: self._done(run, job, min(left, most), seconds))

    def _done(self, run: str, job: Job, particles: int, seconds: float) -> None:
        self.busy = False
        if self.gone:
            return
        self.turns.charge(run, seconds)
        self.served[run] = self.served.get(run, 0.0) + seconds
        job.done, job.served = job.done + particles, job.served + seconds
        if job.done < job.request.batch.stop - job.request.batch.start:
            self.turns.put(run, job, first=True)
        else:
            waited = self.clock.now - job.arrived - job.served
            self.clock.after(LINK_S, lambda: job.end(waited))
        self._next()


class SimulatedRoom:
    """A coordinator of workers that all belong to others, too."""

    def __init__(self, clock: Clock, name: str, workers: dict[str, SimulatedWorker]) -> None:
        self.scheduler = Scheduler(lambda worker: zlib.crc32(f"{name} {worker}".encode()))
        self.delays: list[float] = []  # of refinements
        self.known: list[tuple[float, float]] = []  # times of live frames, and when they were known after it
        self.gone = False
        self._clock, self._name, self._workers = clock, name, workers
        self._numbers = count()
        self._begun: dict[int, Callable[[], None]] = {}
        for worker in workers:
            self.meet(worker)
        self._tick()

    def meet(self, worker: str) -> None:
        """A worker has joined."""
        self._send(self.scheduler.join(worker, self._workers[worker].offer, self._clock.now))

    def miss(self, worker: str) -> None:
        """A worker has left."""
        self._send(self.scheduler.leave(worker, self._clock.now))

    def leave(self) -> None:
        """It is killed."""
        self.gone = True
        for worker in self._workers.values():
            worker.turns.drop(self._name)

    def live(self, fps: float, particles: int, around_s: float, phase: float) -> None:
        """Track frames of a camera, always the newest; `around_s` is the time besides the refinement."""
        taken = -1

        def take() -> None:
            nonlocal taken
            if self.gone:
                return
            newest = math.floor((self._clock.now - phase) * fps + 1e-9)
            if newest <= taken:
                self._clock.after(phase + (taken + 1) / fps - self._clock.now, take)
                return
            taken, at = newest, phase + newest / fps

            def known() -> None:
                self.known.append((at, self._clock.now - at))
                take()

            self._clock.after(around_s, lambda: self.refine(particles, known))

        self._clock.after(phase, take)

    def load(self, particles: int, under_way: int = 1) -> None:
        """Begin refinements, each again when it ends."""
        for _ in range(under_way):
            self.refine(particles, lambda: self.load(particles))

    def refine(self, particles: int, then: Callable[[], None]) -> None:
        """Begin a refinement."""
        number, began = next(self._numbers), self._clock.now

        def end() -> None:
            self.delays.append(self._clock.now - began)
            then()

        self._begun[number] = end
        self._send(self.scheduler.start(number, particles, began))

    def _send(self, requests: list[Request]) -> None:
        for each in requests:
            job = Job(each, 0.0, lambda waited, each=each: self._end(each, waited))  # type: ignore[misc]
            self._clock.after(LINK_S, lambda job=job, each=each: self._arrive(job, each))  # type: ignore[misc]

    def _arrive(self, job: Job, request: Request) -> None:
        job.arrived = self._clock.now
        self._workers[request.worker.name].receive(self._name, job)

    def _end(self, request: Request, waited: float) -> None:
        self._send(self.scheduler.end(request.ticket, "refined", self._clock.now, waited=waited))
        left = {batch.refinement for batch in self.scheduler.batches}
        for number in [number for number in self._begun if number not in left]:
            self._begun.pop(number)()

    def _tick(self) -> None:
        self._send(self.scheduler.dispatch(self._clock.now))
        self._clock.after(LIMITS.tick_s, self._tick)
