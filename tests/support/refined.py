"""Results of refinement that are there at once."""

from __future__ import annotations

from dataclasses import dataclass

from common.refinement import Refined
from coordinator.pool.statistics import PoolStatistics
from gepf.direct import DirectRefiner


@dataclass(frozen=True, slots=True, eq=False)
class Ready:
    """Particles that nobody needs to wait for."""

    refined: Refined

    def result(self) -> Refined:
        """The particles."""
        return self.refined


class Direct(DirectRefiner):
    """Refines in this process, and has no statistics."""

    statistics = PoolStatistics()
