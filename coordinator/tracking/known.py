"""What is known of a body before a tracker sees its first frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coordinator.bodies.tracked import Bodies
from coordinator.tracking.observing.known_motion import KnownMotion
from coordinator.tracking.starting.start import Start, given_start, no_start
from coordinator.tracking.state import TrackerState, load_generator


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """What is known of a body beside the frames.

    Args:
        start: Values of degrees of freedom in the first frame, metres and radians; None to find the body.
        state: Go on from here, where another tracker of the same settings left off.
        motion: How joints move, as encoders report it.
    """

    start: Mapping[str, float] | None = None
    state: TrackerState | None = None
    motion: KnownMotion | None = None

    def begin(self, bodies: Bodies) -> Start:
        """Where tracking begins; nobody's start until the body is found."""
        return no_start(bodies) if self.start is None else given_start(self.start, bodies)

    def generator(self, seed: int) -> np.random.Generator:
        """What all that is drawn is drawn from: where that was left, else from its beginning."""
        if self.state is None:
            return np.random.default_rng(seed)
        return load_generator(self.state.checkpoint.generator)
