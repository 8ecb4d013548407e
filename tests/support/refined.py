"""Results of refinement that are there at once."""

from __future__ import annotations

from dataclasses import dataclass

from common.refinement import Refined


@dataclass(frozen=True, slots=True, eq=False)
class Ready:
    """Particles that nobody needs to wait for."""

    refined: Refined

    def result(self) -> Refined:
        """The particles."""
        return self.refined
