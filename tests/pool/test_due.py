"""When a request that is due may do with what has been answered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.protocol.messages import RefineRequest, encode_refined
from common.refinement import Refined
from common.settings import preset
from coordinator.pool.dispatch.events import MOST_TOGETHER
from coordinator.pool.refinement import Refinement

PARTICLES, DOFS = 6, 7
REQUEST = RefineRequest("run", 0, "model", preset("default").refine, np.zeros((PARTICLES, DOFS)), None)


def answered(refinement: Refinement, ticket: int, start: int, stop: int) -> None:
    """Have these particles answered."""
    count = stop - start
    part = Refined(np.zeros((count, DOFS)), np.zeros(count), np.zeros(count))
    refinement.receive(ticket, encode_refined(part), count)
    refinement.accept(ticket, start)


def test_a_frame_waits_for_a_particle_of_its_own() -> None:
    """What is asked beside it may be answered first: that alone is no frame."""
    refinement = Refinement(REQUEST, due=1.0, spare=2)
    answered(refinement, 1, 4, 6)
    assert not refinement.is_due(2.0)
    answered(refinement, 2, 0, 2)
    assert not refinement.is_due(0.5)
    assert refinement.is_due(2.0)
    np.testing.assert_array_equal(refinement.gather().answered, [0, 1, 4, 5])


def test_a_reply_is_about_as_many_particles_as_fit() -> None:
    """Covariances of many degrees of freedom are large; without them the number alone counts."""
    assert Refinement(REQUEST).most == Refinement(replace(REQUEST, covariance=True)).most == MOST_TOGETHER
    many = replace(REQUEST, poses=np.zeros((2, 500)))
    assert Refinement(many).most == MOST_TOGETHER
    assert Refinement(replace(many, covariance=True)).most == 66
