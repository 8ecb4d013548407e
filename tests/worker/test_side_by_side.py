"""Lanes refine what one refines alone, byte for byte, whatever their number and what they refined before."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from common.errors import ProtocolError
from common.refinement import Refined
from tests.support.bodies import hinges, puppet
from tests.support.kernel.kernel_cases import DEFAULT, PAPER, starts, subject
from worker.kernel.icp import refine
from worker.kernel.observation import observe
from worker.lanes import Lanes, SideBySide


def as_bytes(refined: Refined) -> bytes:
    """All that came out."""
    return refined.poses.tobytes() + refined.log_likelihood.tobytes() + refined.residual.tobytes()


@pytest.mark.parametrize("lanes", [1, 3])
def test_any_number_of_lanes_gives_the_same_bytes(lanes: int) -> None:
    """Fewer, as many and more particles than lanes, with either preset."""
    observation = observe(subject())
    with Lanes(lanes) as threads:
        side_by_side = SideBySide(threads)
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
    with Lanes(2) as threads:
        side_by_side = SideBySide(threads)
        for model, observation, poses in requests:
            together = side_by_side.refine(model, observation, poses, DEFAULT)
            assert as_bytes(together) == as_bytes(refine(model, observation, poses, DEFAULT))


def test_what_is_prepared_ahead_changes_nothing() -> None:
    """For the settings of the request to come, or for others: the same bytes as without."""
    with Lanes(2) as threads:
        side_by_side = SideBySide(threads)
        for prepared in (DEFAULT, msgspec.structs.replace(DEFAULT, noise_depth=10.0 * DEFAULT.noise_depth)):
            observation = observe(subject())
            side_by_side.prepare(observation, prepared)
            together = side_by_side.refine(puppet(), observation, starts(5), DEFAULT)
            assert as_bytes(together) == as_bytes(refine(puppet(), observe(subject()), starts(5), DEFAULT))


def test_what_one_lane_refuses_all_refuse() -> None:
    """A request that asks for too much work is refused before a lane begins."""
    endless = np.zeros((100_000, len(puppet().dof_names)))
    with Lanes(2) as threads, pytest.raises(ProtocolError, match="steps of work"):
        SideBySide(threads).refine(
            puppet(), observe(subject()), endless, msgspec.structs.replace(PAPER, icp_iterations=100)
        )
