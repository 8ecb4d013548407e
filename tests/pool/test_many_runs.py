"""Several runs on one pool: each is served, has its own bytes, and is forgotten after its end."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from itertools import count
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gepf.common.errors import BusError
from gepf.common.protocol import keys
from gepf.common.protocol.frames import encode_frame
from gepf.common.protocol.messages import encode_request
from gepf.common.refinement import Refined
from gepf.common.transport.bus import Bus
from gepf.common.transport.opening import open_router, open_worker
from gepf.coordinator.pool.options import Pool
from gepf.coordinator.pool.zenoh_refiner import ZenohRefiner
from gepf.worker.memory import Memory
from gepf.worker.service import Kernel, Service
from tests.support.answers import as_bytes
from tests.support.processes.instant_worker import observe, refine
from tests.support.processes.programs import wait_until
from tests.support.processes.serving import MODEL, PARTICLES, REQUEST, expected, frame, refined_bytes, running


def test_memory_is_bounded_and_freed() -> None:
    """However many frames and runs there are, few are kept; a run that is over leaves nothing."""
    memory = Memory(cast("Bus", None), lambda subject, _: subject.frame.number)
    for run in range(100):
        for number in range(10):
            memory.put_frame(str(run), number, encode_frame(frame(number)))
    assert len(memory) < 50
    assert memory.observation(replace(REQUEST, run="99", frame=9)) == 9
    kept = memory._runs["99"]
    assert 0 < len(kept.frames) < 10
    assert kept.observations == {9: 9}
    memory.forget("99")
    memory.observe_ahead("99")
    assert "99" not in memory._runs


def test_a_request_of_a_run_that_has_ended_leaves_nothing() -> None:
    """The news of the end may overtake it."""
    memory = Memory(cast("Bus", SimpleNamespace(fetch=lambda *_: None)), lambda *_: None)
    with pytest.raises(BusError, match="not available"):
        memory.observation(REQUEST)
    assert len(memory) == 0
    memory.put_frame(REQUEST.run, REQUEST.frame + 1, encode_frame(frame(REQUEST.frame + 1)))
    with pytest.raises(BusError, match="not available"):
        memory.observation(REQUEST)
    assert len(memory) == 1  # another frame has come, so the run goes on


def test_threads_that_wait_for_one_that_fails_go_on() -> None:
    """The next one observes the frame, once for all the others."""
    tries = count()

    def fail_at_first(*_: object) -> int:
        time.sleep(0.1)  # the others come
        return 1 // next(tries)

    memory = Memory(cast("Bus", None), fail_at_first)
    memory.put_frame(REQUEST.run, REQUEST.frame, encode_frame(frame(REQUEST.frame)))
    search = replace(REQUEST, particles=replace(REQUEST.particles, spare=True))
    with ThreadPoolExecutor(4) as threads:
        asked = [threads.submit(memory.observation, search) for _ in range(4)]
    assert sum(isinstance(each.exception(), ZeroDivisionError) for each in asked) == 1
    assert next(tries) == 2


@pytest.mark.parametrize("through", ["a router", "links of its own"])
def test_one_worker_serves_two_runs_and_forgets_who_is_gone(endpoint: str, through: str) -> None:
    """Each has its own frames of one number, and its own bytes; when one ends, the other goes on.

    However many requests of a search wait then, they are not served, and those of the other are not lost.
    """
    released = threading.Event()
    released.set()

    def hold(*given: Any, **options: Any) -> Refined:
        assert released.wait(60.0)
        return refine(*given, **options)

    own = [endpoint, f"{endpoint}-2"]
    connect = [endpoint] if through == "a router" else own
    options = [
        Pool(workers=0, connect=endpoint, worker_timeout=60.0)
        if through == "a router"
        else Pool(workers=0, listen=each, worker_timeout=60.0)
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
            again = replace(shown, frame=replace(shown.frame, number=number))
            assert refined_bytes(one, number) == expected(number)
            assert as_bytes(two.submit(again, MODEL, PARTICLES).result()) == expected(10 + number)
        assert len(service._memory) == 2
        released.clear()
        held = two.submit(frame(98), MODEL, PARTICLES)
        sender = one._bus.request_sender(keys.of_worker("w", "refine"), 60.0)
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
