"""Several runs on one pool: each gets its turn and its own bytes, and is forgotten when it is gone."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.protocol import keys
from common.protocol.messages import encode_request
from common.refinement import Refined
from common.transport.opening import open_router, open_worker
from coordinator.pool.options import Pool
from coordinator.pool.zenoh_refiner import ZenohRefiner
from tests.support.asked import Asked, refining
from tests.support.processes.instant_worker import KERNEL, answer, observe
from tests.support.processes.programs import wait_until
from tests.support.processes.serving import (
    MODEL,
    POSES,
    REQUEST,
    SETTINGS,
    as_bytes,
    expected,
    frame,
    refined_bytes,
    running,
)
from worker.memory import Memory
from worker.service import FairQueue, Kernel, Service


@given(st.lists(st.sampled_from("abc"), max_size=30))
def test_turns_keep_the_order_within_a_run_and_alternate_between_runs(runs: list[str]) -> None:
    """Nothing is lost; while two runs wait neither is served twice in a row."""
    queue: FairQueue[tuple[str, int]] = FairQueue()
    for number, run in enumerate(runs):
        queue.put(run, (run, number))
    left = dict.fromkeys("abc", 0)
    served: list[tuple[str, int]] = []
    for run in runs:
        left[run] += 1
    while queue:
        others = {run for run in "abc" if left[run]}
        run, number = queue.take()
        assert not served or served[-1][0] != run or others == {run}
        served.append((run, number))
        left[run] -= 1
    for run in "abc":
        assert [n for r, n in served if r == run] == [n for n, r in enumerate(runs) if r == run]


def test_a_run_that_comes_waits_for_one_request_of_each_other() -> None:
    """However many requests another run has waiting."""
    queue: FairQueue[str] = FairQueue()
    for number in range(5):
        queue.put("long", f"long {number}")
    assert queue.take() == "long 0"
    queue.put("short", "short 0")
    assert [queue.take() for _ in range(3)] == ["long 1", "short 0", "long 2"]
    assert queue.forget("long") == ["long 3", "long 4"]
    assert not queue
    with pytest.raises(IndexError):
        queue.take()


def test_the_run_with_most_requests_makes_room() -> None:
    """However many requests come, a limited number waits, and another run is served all the same."""
    queue: FairQueue[str] = FairQueue()
    assert queue.put("calm", "calm 0") is None
    dropped = [queue.put("flood", f"flood {number}") for number in range(1000)]
    waiting = queue.forget("flood")
    assert [each for each in dropped if each is not None] + waiting == [f"flood {n}" for n in range(1000)]
    assert len(waiting) < 100
    assert queue.take() == "calm 0"


def test_memory_is_bounded_and_freed() -> None:
    """However many frames and runs there are, few are kept; a run that is over leaves nothing."""
    memory: Memory[str] = Memory()
    for run in range(100):
        for number in range(10):
            memory.put_frame(str(run), number, b"x")
    assert len(memory) < 50
    kept = [number for number in range(10) if memory.wait_for_frame("99", number, 0.0)]
    assert 0 < len(kept) < 5
    memory.forget("99")
    assert memory.wait_for_frame("99", kept[-1], 0.0) is None


@contextmanager
def worker(connect: list[str], kernel: Kernel[Any] = KERNEL) -> Iterator[Service[Any]]:
    """A worker in a thread."""
    with open_worker(connect) as bus, running(Service(bus, "w", kernel)) as service:
        yield service


@pytest.mark.parametrize("through", ["a router", "links of its own"])
def test_one_worker_serves_two_runs_and_forgets_who_is_gone(endpoint: str, through: str) -> None:
    """Each has its own frames of one number, and its own bytes; when one ends, the other goes on."""
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
        service = stack.enter_context(worker(connect))
        for number in range(4):
            shown = frame(10 + number)
            two.publish(replace(shown, frame=replace(shown.frame, number=number)))
            assert refined_bytes(one, number) == expected(number)
            assert as_bytes(two.submit(MODEL, POSES, SETTINGS).result()) == expected(10 + number)
        assert len(service._memory) == 2
        one.__exit__(None, None, None)
        wait_until(lambda: len(service._memory) == 1)
        assert refined_bytes(two, 99) == expected(99)


def test_a_run_with_much_to_do_does_not_hold_up_another(endpoint: str) -> None:
    """One asks for eight batches; amid the first another asks for one, and waits for one more at the most."""
    served: list[float] = []
    may_go_on = threading.Event()

    def held(asked: Asked, seen: float) -> Refined:
        served.append(round(1000 * (seen - 2.0)))
        may_go_on.wait(60.0)
        return answer(asked, seen)

    options = Pool(workers=0, connect=endpoint, worker_timeout=60.0)
    with (
        open_router([endpoint]),
        ZenohRefiner(options) as greedy,
        ZenohRefiner(options) as modest,
        worker([endpoint], Kernel(observe, refining(held))) as service,
    ):
        modest.wait_for(1)
        may_go_on.set()
        greedy.publish(frame(1))
        greedy.submit(MODEL, POSES[:1], SETTINGS).result()
        may_go_on.clear()
        served.clear()
        sender = greedy._bus.request_sender(keys.worker_refine("w"), 60.0)
        for _ in range(8):
            request = replace(REQUEST, run=greedy.run, frame=1)
            sender.send(
                encode_request(request),
                on_reply=lambda _: None,
                on_refusal=lambda _: None,
                on_end=lambda: None,
            )
        wait_until(lambda: bool(served))
        modest.publish(frame(2))
        asking = threading.Thread(target=modest.submit(MODEL, POSES[:1], SETTINGS).result)
        asking.start()
        wait_until(lambda: waiting_at(service) >= 8)  # seven of the first, and another's
        may_go_on.set()
        asking.join(60.0)
        assert served.index(2) <= 2, served


def waiting_at(service: Service[Any]) -> int:
    """Requests that have come to a worker, which is busy, and are not being served yet.

    What only wakes it is none, and is taken away: a frame that comes does so.
    """
    assert service._requests is not None
    arrivals = service._requests._waiting
    arrived = [query for query in (arrivals.get() for _ in range(arrivals.qsize())) if query is not None]
    for query in arrived:
        arrivals.put(query)
    return sum(map(len, service._queue._waiting.values())) + len(arrived)
