"""A pool that several coordinators share: fair turns, no double work, kinds of workers, frames by need."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from queue import SimpleQueue
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gepf.common.errors import NoWorkers
from gepf.common.kernel import Kernel
from gepf.common.offer import Offer
from gepf.common.protocol.messages import decode_request
from gepf.common.refinement import Particles, Refined
from gepf.common.transport.channels import IncomingRequest
from gepf.common.transport.opening import open_router, open_worker
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.worker.memory import MemoryLimits
from gepf.worker.service import Service
from tests.support.answers import as_bytes
from tests.support.processes.instant_worker import observe, refine
from tests.support.processes.programs import wait_until
from tests.support.processes.serving import (
    MODEL,
    PARTICLES,
    POSES,
    SETTINGS,
    WatchedBus,
    expected,
    frame,
    pool,
    refined_bytes,
    running,
    serving,
)
from tests.support.simulated_pool import Clock, SimulatedRoom, SimulatedWorker


def simulated(
    lanes: list[int], particles: dict[str, int], seconds: float
) -> tuple[list[SimulatedWorker], dict[str, SimulatedRoom]]:
    """Workers and rooms that always have eight refinements of so many particles under way, after a time."""
    clock = Clock()
    workers = {f"w{n}": SimulatedWorker(clock, Offer(lanes=each), 0.005) for n, each in enumerate(lanes)}
    rooms = {name: SimulatedRoom(clock, name, workers) for name in particles}
    for name, room in rooms.items():
        room.load(particles[name], 8)
    clock.run(seconds)
    return list(workers.values()), rooms


@settings(max_examples=10)
@given(
    st.lists(st.integers(1, 8), min_size=1, max_size=4),
    st.lists(st.integers(50, 2000), min_size=2, max_size=6),
)
def test_loaded_rooms_have_equal_shares(lanes: list[int], particles: list[int]) -> None:
    """However large their requests are; hardly any work is done twice, before a room knows the usual wait."""
    rooms_of = {f"room-{n}": each for n, each in enumerate(particles)}
    workers, rooms = simulated(lanes, rooms_of, 20.0)
    worked = {room: sum(w.served.get(room, 0.0) * w.offer.slots for w in workers) for room in rooms}
    assert min(worked.values()) > 0.75 * max(worked.values())
    sent, again = (sum(getattr(r.scheduler, n) for r in rooms.values()) for n in ("sent", "sent_again"))
    assert again <= 0.03 * sent


@pytest.mark.parametrize("others", [1, 4, 8])
def test_a_small_request_waits_for_a_turn_of_each_other_room_only(others: int) -> None:
    """Not for their whole requests, of two seconds on each worker."""
    clock = Clock()
    workers = {name: SimulatedWorker(clock, Offer(lanes=2), 0.005) for name in ("a", "b")}
    for n in range(others):
        SimulatedRoom(clock, f"flood-{n}", workers).load(1600, 8)
    room = SimulatedRoom(clock, "room", workers)

    def track() -> None:
        clock.after(0.5, lambda: room.refine(4, track))

    track()
    clock.run(20.0)
    turn = 4 * 0.005
    assert len(room.delays) > 25
    assert max(room.delays[1:]) < (2 + others) * turn + 0.02


FPS, IN_TIME_S, PARTICLES_OF_ROOM, AROUND_S, PARTICLE_S = 30.0, 0.067, 20, 0.01, 0.0018


class Rooms:
    """Eight rooms live at workers of four lanes, in simulated time."""

    def __init__(self, workers: int, lanes: int = 4, rooms: int = 8) -> None:
        self.clock = Clock()
        self.workers = {f"w{n}": self._worker(lanes) for n in range(workers)}
        self.rooms = [SimulatedRoom(self.clock, f"room-{n}", self.workers) for n in range(rooms)]
        for n, room in enumerate(self.rooms):
            room.live(FPS, PARTICLES_OF_ROOM, AROUND_S, n / FPS / rooms)

    def _worker(self, lanes: int) -> SimulatedWorker:
        return SimulatedWorker(self.clock, Offer(lanes=lanes), PARTICLE_S)

    def leave(self, name: str) -> None:
        """A worker is killed."""
        self.workers[name].gone = True
        for room in self.rooms:
            room.miss(name)

    def join(self, name: str) -> None:
        """A worker starts again."""
        self.workers[name] = self._worker(4)
        for room in self.rooms:
            room.meet(name)

    def shares(self, seconds: float) -> list[float]:
        """The share of frames that each room knows in time, from now on."""
        begin = self.clock.now
        self.clock.run(begin + seconds + 1.0)
        within = [[at for at, delay in each.known if delay <= IN_TIME_S] for each in self.rooms]
        return [sum(begin <= at < begin + seconds for at in times) / FPS / seconds for times in within]


@pytest.mark.parametrize("workers", [4, 2])
def test_no_live_room_is_below_its_fair_share(workers: int) -> None:
    """With enough lanes and with half of them: each of eight rooms knows as many frames as it would alone.

    While all is calm, workers leave and join, after a room has gone, and while a run floods the workers.
    """
    (alone,) = Rooms(1, workers * 4 // 8, 1).shares(4.0)
    together = Rooms(workers)
    together.clock.run(1.0)
    assert min(together.shares(4.0)) > 0.95 * alone
    for n in range(3):
        together.clock.after(1.5 * n, lambda n=n: together.leave(f"w{n % workers}"))  # type: ignore[misc]
        together.clock.after(1.5 * n + 0.5, lambda n=n: together.join(f"w{n % workers}"))  # type: ignore[misc]
    assert min(together.shares(4.0)) > 0.8 * alone
    together.rooms.pop().leave()
    assert min(together.shares(4.0)) > 0.95 * alone
    for worker in together.workers.values():
        worker.flood("flood", 64, 1000)
    assert min(together.shares(4.0)) > 0.8 * alone


def test_turns_are_taken_within_a_large_request(endpoint: str) -> None:
    """On a real worker: a request is served when a part of another room's is done; no byte changes."""
    began, resume, served = threading.Event(), threading.Event(), SimpleQueue[int]()
    small_waits = threading.Event()

    class WatchedService(Service):
        def _accept(self, request: IncomingRequest) -> None:
            super()._accept(request)
            asked = decode_request(request.payload)
            if asked.run == two.run and len(asked.particles.poses) == 3:
                small_waits.set()

    def wait_and_refine(model: Any, seen: Any, particles: Particles) -> Refined:
        served.put(len(particles.poses))
        if len(particles.poses) == 4 and not began.is_set():
            began.set()
            assert resume.wait(300.0)
        return refine(model, seen, particles)

    with ExitStack() as stack:
        stack.enter_context(open_router([endpoint]))
        one, two = (stack.enter_context(ZenohRefiner(Pool(0, connect=endpoint))) for _ in range(2))
        bus = stack.enter_context(open_worker([endpoint]))
        stack.enter_context(running(WatchedService(bus, "w", Kernel(observe, wait_and_refine))))
        stack.callback(resume.set)
        assert refined_bytes(one, 1, POSES[:1]) == expected(1, POSES[:1])
        assert refined_bytes(two, 1, POSES[:2]) == expected(1, POSES[:2])
        large = one.submit(frame(2), MODEL, PARTICLES)
        assert began.wait(300.0)
        small = two.submit(frame(2), MODEL, Particles(POSES[:3], SETTINGS))
        assert small_waits.wait(300.0)
        resume.set()
        assert as_bytes(small.result()) == expected(2, POSES[:3])
        assert as_bytes(large.result()) == expected(2)
        sizes = [served.get(timeout=300.0) for _ in range(8)]
    assert sizes == [1, 2, 4, 3, 4, 4, 4, 4]


def test_a_search_is_served_beside_anothers_tracking_that_never_pauses(endpoint: str) -> None:
    """Although the threads for searches get no processor time at all."""
    never = threading.Event()

    def refine_urgent(model: Any, seen: Any, particles: Particles) -> Refined:
        if particles.spare:
            assert never.wait(300.0)
        return refine(model, seen, particles)

    with ExitStack() as stack:
        stack.enter_context(open_router([endpoint]))
        tracking, searching = (stack.enter_context(ZenohRefiner(Pool(0, connect=endpoint))) for _ in range(2))
        stack.enter_context(serving(endpoint, "w", Kernel(observe, refine_urgent)))
        stack.callback(never.set)
        sought = [searching.submit(frame(1), MODEL, replace(PARTICLES, spare=True)) for _ in range(4)]
        ready = 0
        while ready < 3:  # the fourth is with the thread that gets no time
            assert refined_bytes(tracking, 1) == expected(1)
            ready = sum(each.poll() for each in sought)


def test_workers_of_another_kind_are_not_used(endpoint: str) -> None:
    """One line says which there are, and what to do; a run of that kind uses them, and records processors."""
    said = list[str]()
    options = Pool(0, listen=endpoint, worker_timeout=1.0)
    with ZenohRefiner(options, said.append) as refiner, serving(endpoint, "gpu", kernel_of("cuda", "h100")):
        wait_until(lambda: not refiner._client._inbox.empty())  # its coming waits to be handled
        with pytest.raises(NoWorkers, match=r"gepf-worker --kind cpu --connect .*, or give --kind cuda"):
            refined_bytes(refiner, 1)
        with serving(endpoint, "w"):
            wait_until(lambda: not refiner._client._inbox.empty())
            assert refined_bytes(refiner, 1) == expected(1)
        assert refiner.statistics.workers_seen == ("w",)
    assert not any("gpu joined" in line for line in said)
    with pool(endpoint, kind="cuda") as refiner, ExitStack() as stack:
        for name, kernel in (("gpu", kernel_of("cuda", "h100")), ("w", kernel_of("cpu", "any"))):
            stack.enter_context(serving(endpoint, name, kernel))
        assert refined_bytes(refiner, 1) == expected(1)
        assert (refiner.statistics.workers_seen, refiner.statistics.processors) == (("gpu",), ("h100",))


def kernel_of(kind: str, processor: str) -> Kernel:
    """A kernel of another kind and processor."""
    return Kernel(observe, refine, Offer(kind, processor))


def step_until(refiner: ZenohRefiner, happened: Callable[[], bool]) -> None:
    """Let a coordinator go on until something has happened."""
    while not happened():
        refiner._client.step()


def test_why_no_worker_is_used_is_said(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also if the first foreign worker comes after the run has said that it waits."""
    monkeypatch.setattr("gepf.coordinator.pool.rpc_client.NOTICE_S", 0.0)
    said = list[str]()
    with ZenohRefiner(Pool(0, listen=endpoint), said.append) as refiner:
        step_until(refiner, lambda: said != [])
        with serving(endpoint, "gpu", kernel_of("cuda", "h100")):
            step_until(refiner, lambda: len(said) > 1)
    assert said[0] == "no worker is connected; waiting for one"
    assert said[1].startswith("no worker of kind 'cpu' is connected, and those of kind cuda are not used; ")


def test_other_processors_are_named(endpoint: str) -> None:
    """A run whose workers may give other last digits says so when the second one joins."""
    said = list[str]()
    with (
        ZenohRefiner(Pool(0, listen=endpoint), said.append) as refiner,
        serving(endpoint, "a", kernel_of("cpu", "zen3")),
    ):
        refiner.wait_for(1)
        with serving(endpoint, "b", kernel_of("cpu", "rocketlake")):
            refiner.wait_for(2)
    assert sum("a different processor" in line for line in said) == 1


def test_more_than_sixteen_runs_at_a_worker_do_not_thrash(
    endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each fetches its first frame and body; the others come, and only to a worker that has had requests."""
    monkeypatch.setattr("gepf.worker.memory.LIMITS", MemoryLimits(frame_delay_s=300.0))
    fetched, idle = SimpleQueue[str](), SimpleQueue[str]()
    with ExitStack() as stack:
        stack.enter_context(open_router([endpoint]))
        runs = [stack.enter_context(ZenohRefiner(Pool(0, connect=endpoint))) for _ in range(20)]
        stack.enter_context(serving(endpoint, "w", through=lambda bus: WatchedBus(bus, iter(()), fetched)))
        for number in range(1, 6):
            for run in runs:
                assert refined_bytes(run, number) == expected(number)
                wait_until(lambda run=run: run._publication._publisher.has_subscriber)  # type: ignore[misc]
        bus = stack.enter_context(open_worker([endpoint]))
        other = Service(WatchedBus(bus, iter(()), idle), "unused", kernel_of("cuda", "h100"))  # type: ignore[arg-type]
        stack.enter_context(running(other))
        step_until(runs[0], lambda: "unused" in runs[0]._client._offers)
        for number in range(6, 9):
            assert refined_bytes(runs[0], number) == expected(number)
        assert (len(other._memory), idle.qsize()) == (0, 0)
    kinds = Counter(fetched.get().split("/")[4] for _ in range(fetched.qsize()))
    assert kinds["model"] == 1
    assert 20 <= kinds["frame"] <= 40  # of 100; the second request may be faster than its frame
