"""Lanes refine what one refines alone, byte for byte, whatever their number and what they refined before."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import msgspec
import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from common.refinement import Refined
from tests.support.bodies import hinges, puppet
from tests.support.kernel.kernel_cases import DEFAULT, PAPER, starts, subject
from worker.kernel.icp import Job, refine
from worker.kernel.observation import observe
from worker.kernel.shared_counter import take_next
from worker.lanes import Lanes


def as_bytes(refined: Refined) -> bytes:
    """All that came out."""
    return refined.poses.tobytes() + refined.log_likelihood.tobytes() + refined.residual.tobytes()


@pytest.mark.parametrize("lanes", [1, 3])
def test_any_number_of_lanes_gives_the_same_bytes(lanes: int) -> None:
    """Fewer, as many and more particles than lanes, with either preset."""
    observation = observe(subject())
    side_by_side = Lanes(lanes)
    for count in (1, lanes, 20):
        for settings in (PAPER, DEFAULT):
            alone = refine(puppet(), observation, starts(count), settings)
            together = side_by_side.refine(puppet(), observation, starts(count), settings)
            assert as_bytes(together) == as_bytes(alone)


def test_a_lane_keeps_nothing_from_one_request_to_the_next() -> None:
    """More points, fewer, another body and the first one again: each as with a workspace made anew."""
    much = observe(subject())
    little = replace(much, points=much.points[:128], count=128)
    bent = np.zeros((3, len(hinges().dof_names)))
    requests = [
        (puppet(), little, starts(5)),
        (puppet(), much, starts(5)),
        (hinges(), much, bent),
        (puppet(), little, starts(7)),
        (puppet(), much, starts(2)),
    ]
    side_by_side = Lanes(2)
    for model, observation, poses in requests:
        together = side_by_side.refine(model, observation, poses, DEFAULT)
        assert as_bytes(together) == as_bytes(refine(model, observation, poses, DEFAULT))


def test_what_is_prepared_ahead_changes_nothing() -> None:
    """For the settings of the request to come, or for others: the same bytes as without."""
    side_by_side = Lanes(2)
    for prepared in (DEFAULT, msgspec.structs.replace(DEFAULT, noise_depth=10.0 * DEFAULT.noise_depth)):
        observation = observe(subject())
        side_by_side.prepare(observation, prepared)
        together = side_by_side.refine(puppet(), observation, starts(5), DEFAULT)
        assert as_bytes(together) == as_bytes(refine(puppet(), observe(subject()), starts(5), DEFAULT))


@pytest.mark.parametrize("faulty", [0, 1, 2])
def test_what_a_lane_raises_comes_out_and_the_next_request_is_served(
    faulty: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other lanes have returned by then."""
    lanes, observation, own = Lanes(3), observe(subject()), Lanes._work_on
    returned: list[int] = []

    def fail(self: Lanes, job: Job, lane: int) -> None:
        if lane == faulty:
            raise ZeroDivisionError
        own(self, job, lane)
        returned.append(lane)

    with monkeypatch.context() as patch:
        patch.setattr(Lanes, "_work_on", fail)
        with pytest.raises(ZeroDivisionError):
            lanes.refine(puppet(), observation, starts(40), DEFAULT)
    assert sorted([*returned, faulty]) == [0, 1, 2]
    together = lanes.refine(puppet(), observation, starts(5), DEFAULT)
    assert as_bytes(together) == as_bytes(refine(puppet(), observation, starts(5), DEFAULT))


def test_a_shared_counter_gives_each_number_once() -> None:
    """Threads that take from one counter at the same time never take the same number."""
    counter, taken = np.zeros(1, dtype=np.int64), np.zeros((4, 2_000_000), dtype=np.int8)
    take_all(counter.copy(), taken[0][:0])
    with ThreadPoolExecutor(4) as threads:
        list(threads.map(lambda lane: take_all(counter, taken[lane]), range(4)))
    assert np.array_equal(taken.sum(axis=0), np.ones(taken.shape[1]))


@numba.njit(nogil=True)
def take_all(counter: NDArray[np.int64], taken: NDArray[np.int8]) -> None:
    """Count each number that is taken, in compiled code, which holds no lock."""
    n: int = take_next(counter)  # type: ignore[call-arg]
    while n < len(taken):
        taken[n] += 1
        n = take_next(counter)
