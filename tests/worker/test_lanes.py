"""Any number of lanes gives the same bytes as one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import msgspec
import pytest

from tests.support.asked import as_bytes
from tests.support.bodies import puppet
from tests.support.kernel.kernel_cases import DEFAULT, PAPER, starts, subject
from worker.kernel.icp import Batch, refine, refine_some
from worker.kernel.observation import observe
from worker.lanes import Lanes


@pytest.mark.parametrize("lanes", [1, 3])
def test_any_number_of_lanes_gives_the_same_bytes(lanes: int) -> None:
    """Fewer, as many and more particles than lanes, with either preset."""
    observation = observe(subject())
    side_by_side = Lanes(lanes)
    for particles in (1, lanes, 20):
        for settings in (PAPER, DEFAULT):
            alone = refine(puppet(), observation, starts(particles), settings)
            together = side_by_side.refine(puppet(), observation, starts(particles), settings)
            assert as_bytes(together) == as_bytes(alone)


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
    lanes, observation = Lanes(3), observe(subject())
    entered, returned = count(), list[int]()

    def fail(batch: Batch, particles: Iterator[int]) -> None:
        lane = next(entered)
        if lane == faulty:
            raise ZeroDivisionError
        refine_some(batch, particles)
        returned.append(lane)

    with monkeypatch.context() as patch:
        patch.setattr("worker.lanes.refine_some", fail)
        with pytest.raises(ZeroDivisionError):
            lanes.refine(puppet(), observation, starts(40), DEFAULT)
    assert sorted([*returned, faulty]) == [0, 1, 2]
    together = lanes.refine(puppet(), observation, starts(5), DEFAULT)
    assert as_bytes(together) == as_bytes(refine(puppet(), observation, starts(5), DEFAULT))
