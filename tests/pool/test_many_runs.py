"""Several runs on one pool: each is served, has its own bytes, and is forgotten after its end."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from itertools import count
from typing import Any, cast

import pytest

from gepf.common.errors import BusError
from gepf.common.kernel import Kernel
from gepf.common.protocol import keys
from gepf.common.protocol.frames import encode_frame
from gepf.common.protocol.messages import RefineRequest, encode_request
from gepf.common.refinement import Refined
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_router, open_worker
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.worker.memory import Memory
from gepf.worker.service import Service
from tests.support.answers import as_bytes
from tests.support.processes.instant_worker import observe, refine
from tests.support.processes.programs import wait_until
from tests.support.processes.serving import MODEL, PARTICLES, REQUEST, expected, frame, refined_bytes, running


class ManyFrames:
    """A bus on which every run has frames 0 to 99, which counts fetches, and on which runs publish."""

    def __init__(self) -> None:
        self.fetched = Counter[str]()
        self.receivers = dict[str, Callable[[str, bytes], None]]()  # by key

    def fetch(self, key: str) -> bytes | None:
        """A frame of any run."""
        self.fetched[key] += 1
        return encode_frame(frame(int(keys.last_of(key)))) if int(keys.last_of(key)) < 100 else None

    def subscribe(self, key: str, receive: Callable[[str, bytes], None]) -> Callable[[], None]:
        """Receive what is published on a key, until the returned function is called."""
        self.receivers[key] = receive
        return lambda: vars(self)["receivers"].pop(key)

    def publish(self, run: str, number: int) -> None:
        """Publish a frame."""
        key = keys.of_run(run, "frame")
        if key in self.receivers:
            self.receivers[key](key, encode_frame(frame(number)))


def asked(run: str, number: int, *, spare: bool = False) -> RefineRequest:
    """A request for a frame of a run."""
    return replace(REQUEST, run=run, frame=number, particles=replace(REQUEST.particles, spare=spare))


def memory_of(bus: ManyFrames) -> Memory:
    """A memory whose observation of a frame is its number."""
    return Memory(cast("Bus", bus), lambda subject, _: subject.number)


def test_a_hundred_runs_do_not_drive_each_other_out() -> None:
    """However many runs take turns, each frame comes once: the first is fetched, before it subscribes."""
    bus = ManyFrames()
    memory, runs = memory_of(bus), [f"room-{n}/run" for n in range(100)]
    for number in range(10):
        for run in runs:
            bus.publish(run, number)
        for _ in range(3):
            assert [memory.observation(asked(run, number)) for run in runs] == [number] * len(runs)
    assert bus.fetched == Counter({keys.of_run(run, "frame/0"): 1 for run in runs})


def test_memory_is_bounded_and_freed() -> None:
    """However many frames and runs there are, few are kept; a run that is over leaves nothing."""
    bus = ManyFrames()
    memory = memory_of(bus)
    for run in range(1000):
        for number in range(3):
            memory.observation(asked(f"room/{run}", number))
            bus.publish(f"room/{run}", 50 + number)
        memory.unsubscribe()
    kept = [len(each.frames) + len(each.observations) for each in memory._runs.values()]
    assert len(memory) == len(bus.receivers) < 1000
    assert sum(kept) < 1500
    memory.forget("room/999")
    memory.observe_ahead("room/999")
    memory.unsubscribe()
    assert "room/999" not in memory._runs
    assert keys.of_run("room/999", "frame") not in bus.receivers


def test_frames_come_as_long_as_there_are_requests() -> None:
    """A run that goes on with other workers costs this one a few frames; another request begins anew."""
    bus = ManyFrames()
    memory, key = memory_of(bus), keys.of_run("room/run", "frame")
    for number in range(100):
        bus.publish("room/run", number)
        memory.unsubscribe()
        if number < 20 or number > 80:
            assert memory.observation(asked("room/run", number)) == number
        if number in {60, 80}:
            assert key not in bus.receivers
    assert set(bus.fetched) == {keys.of_run("room/run", f"frame/{number}") for number in (0, 81)}


def test_a_request_of_a_run_that_has_ended_leaves_nothing() -> None:
    """The news of the end may overtake it."""
    bus = ManyFrames()
    memory = memory_of(bus)
    with pytest.raises(BusError, match="not available"):
        memory.observation(asked("room/run", 100))
    memory.unsubscribe()
    assert len(memory) == len(bus.receivers) == 0
    assert memory.observation(asked("room/run", 1)) == 1
    with pytest.raises(BusError, match="not available"):
        memory.observation(asked("room/run", 100))
    assert len(memory) == 1  # another frame has come, so the run goes on


def test_threads_that_wait_for_one_that_fails_go_on() -> None:
    """The next one observes the frame, once for all the others."""
    tries = count()

    def fail_at_first(*_: object) -> int:
        time.sleep(0.1)  # the others come
        return 1 // next(tries)

    memory = Memory(cast("Bus", ManyFrames()), fail_at_first)
    search = asked("room/run", 1, spare=True)
    with ThreadPoolExecutor(4) as threads:
        answers = [threads.submit(memory.observation, search) for _ in range(4)]
    assert sum(isinstance(each.exception(), ZeroDivisionError) for each in answers) == 1
    assert next(tries) == 2


@pytest.mark.parametrize("through", ["a router", "links of its own"])
def test_one_worker_serves_two_runs_and_forgets_who_is_gone(endpoint: str, through: str) -> None:
    """Each has its own frames of one number, and its own bytes; when one ends, the other goes on.

    However many requests of a search wait then, they are not served, and those of the other are not lost.
    """
    released = threading.Event()
    released.set()

    def hold(*given: Any, **options: Any) -> Refined:
        assert released.wait(300.0)
        return refine(*given, **options)

    own = [endpoint, f"{endpoint}-2"]
    connect = [endpoint] if through == "a router" else own
    options = [
        Pool(workers=0, connect=endpoint, worker_timeout=300.0)
        if through == "a router"
        else Pool(workers=0, listen=each, worker_timeout=300.0)
        for each in own
    ]
    with ExitStack() as stack:
        if through == "a router":
            stack.enter_context(open_router([endpoint]))
        one, two = (stack.enter_context(ZenohRefiner(each)) for each in options)
        bus = stack.enter_context(open_worker(connect))
        service = stack.enter_context(running(Service(bus, "w", Kernel(observe, hold))))
        for number in range(4):
            shown = frame(10 + number)
            again = replace(shown, number=number)
            assert refined_bytes(one, number) == expected(number)
            assert as_bytes(two.submit(again, MODEL, PARTICLES).result()) == expected(10 + number)
        assert len(service._memory) == 2
        released.clear()
        held = two.submit(frame(98), MODEL, PARTICLES)
        sender = one._bus.request_sender(keys.of_worker("w", "refine/coordinator"), 300.0)
        for _ in range(100):
            spare = replace(REQUEST, run=one.run, particles=replace(REQUEST.particles, spare=True))
            sender.send(encode_request(spare), lambda *_: None)
        waits = [two.submit(frame(99), MODEL, replace(PARTICLES, spare=last)) for last in (False, True)]
        one.__exit__(None, None, None)
        wait_until(lambda: len(service._memory) == 1)
        released.set()
        results = [as_bytes(each.result()) for each in (held, *waits)]
        assert results == [expected(98), expected(99), expected(99)]
        wait_until(lambda: len(service._memory) == 1)  # late requests of the other have been refused
        assert one.run not in service._memory._runs
        assert two.statistics.counts["batches_sent_again"] == 0
