"""Deadlines: a late request ends with the particles that were answered."""

from __future__ import annotations

from typing import cast

import numpy as np

from common.protocol.messages import RefineRequest
from common.refinement import Refined
from common.settings import preset
from coordinator.pool.rpc_client import Refinement, RpcClient

PARTICLES, DOFS = 6, 7
REQUEST = RefineRequest("run", 0, "model", preset("default").refine, np.zeros((PARTICLES, DOFS)))


class NoClient:
    """Waits for nothing."""

    def finish(self, _: Refinement) -> None:
        """Return at once."""


def part(count: int) -> Refined:
    """A part of a reply with this number of particles."""
    return Refined(np.zeros((count, DOFS)), np.zeros(count), np.zeros(count))


def test_a_frame_waits_for_one_particle_at_least() -> None:
    """A deadline applies after the first refined batch; missing particles are NaN."""
    refinement = Refinement(cast("RpcClient", NoClient()), 0, REQUEST, due=1.0)
    assert not refinement.is_over(2.0)
    refinement.parts[4] = part(2)
    assert not refinement.is_over(0.5)
    refinement.parts[0] = part(2)
    assert refinement.is_over(2.0)
    np.testing.assert_array_equal(refinement.result().answered, [0, 1, 4, 5])
    refinement.parts[2] = part(2)
    assert refinement.is_over(0.5)
    assert len(refinement.result().answered) == PARTICLES
