"""Lanes: every number is taken once, all lanes work at the same time, and faults come out."""

from __future__ import annotations

import threading

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from worker.kernel.shared_counter import take_next
from worker.lanes import Lanes


def never() -> None:
    """Nothing is to be stopped."""
    raise AssertionError("nothing should be stopped")


@pytest.mark.parametrize("count", [1, 2, 8])
def test_all_lanes_work_at_once(count: int) -> None:
    """Each lane is called once, with its number, while the others are still at work."""
    meeting = threading.Barrier(count, timeout=60.0)
    seen: list[int] = []

    def work(lane: int) -> None:
        meeting.wait()
        seen.append(lane)

    with Lanes(count) as lanes:
        for _ in range(3):
            lanes.run(work, count, never)
    assert sorted(seen) == sorted(3 * list(range(count)))


def test_only_as_many_as_are_asked_for() -> None:
    """A request of two particles wakes no third lane."""
    seen: list[int] = []
    with Lanes(5) as lanes:
        lanes.run(seen.append, 2, never)
    assert sorted(seen) == [0, 1]


@pytest.mark.parametrize("faulty", [0, 1, 2])
def test_a_fault_is_raised_when_all_have_returned(faulty: int) -> None:
    """What a lane raises comes out, the others stop, and the next request is served."""
    stopped = threading.Event()

    def work(lane: int) -> None:
        if lane == faulty:
            raise ZeroDivisionError
        assert stopped.wait(60.0)

    with Lanes(3) as lanes:
        with pytest.raises(ZeroDivisionError):
            lanes.run(work, 3, stopped.set)
        seen: list[int] = []
        lanes.run(seen.append, 3, never)
    assert sorted(seen) == [0, 1, 2]


def test_a_shared_counter_gives_each_number_once() -> None:
    """Threads that take from one counter at the same time never take the same number."""
    counter, taken = np.zeros(1, dtype=np.int64), np.zeros((4, 2_000_000), dtype=np.int8)
    take_all(counter.copy(), taken[0][:0])

    with Lanes(4) as lanes:
        lanes.run(lambda lane: take_all(counter, taken[lane]), 4, never)
    assert np.array_equal(taken.sum(axis=0), np.ones(taken.shape[1]))


@numba.njit(nogil=True)
def take_all(counter: NDArray[np.int64], taken: NDArray[np.int8]) -> None:
    """Count each number that is taken, in compiled code, which holds no lock."""
    n: int = take_next(counter)  # type: ignore[call-arg]
    while n < len(taken):
        taken[n] += 1
        n = take_next(counter)
