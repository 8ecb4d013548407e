"""When a request that is due may do with what has been answered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.protocol.messages import RefineRequest, encode_refined
from common.refinement import Refined
from common.settings import preset
from coordinator.pool.rpc_client import Refinement

PARTICLES, DOFS = 6, 7
REQUEST = RefineRequest("run", 0, "model", preset("default").refine, np.zeros((PARTICLES, DOFS)))


def answered(refinement: Refinement, ticket: int, start: int, stop: int) -> None:
    """Have these particles answered."""
    count = stop - start
    part = Refined(np.zeros((count, DOFS)), np.zeros(count), np.zeros(count))
    refinement.receive(ticket, encode_refined(part), count)
    refinement.accept(ticket, start)


def test_a_frame_waits_for_one_particle_at_least() -> None:
    """A deadline is kept once one batch was refined; what is missing then is not a number."""
    refinement = Refinement(REQUEST, due=1.0)
    assert not refinement.is_due(2.0)
    answered(refinement, 1, 4, 6)
    assert not refinement.is_due(0.5)
    answered(refinement, 2, 0, 2)
    assert refinement.is_due(2.0)
    np.testing.assert_array_equal(refinement.gather().answered, [0, 1, 4, 5])


def test_a_batch_is_no_larger_than_its_reply_may_be() -> None:
    """Covariances of many degrees of freedom are large, those of few change nothing."""
    many = replace(REQUEST, poses=np.zeros((2, 500)))
    usual = Refinement(REQUEST).largest_batch
    assert Refinement(many).largest_batch == usual
    assert Refinement(replace(REQUEST, covariance=True)).largest_batch == usual
    assert Refinement(replace(many, covariance=True)).largest_batch == 66
