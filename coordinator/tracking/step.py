"""A frame whose particles are refined, before it is assessed."""

from __future__ import annotations

from dataclasses import dataclass

from common.frame import DepthFrame
from coordinator.filters.belief import Belief
from coordinator.tracking.certainty.evidence import Sighted
from coordinator.tracking.estimate import Status
from coordinator.tracking.loop import Stopwatch
from coordinator.tracking.state import TrackerState


@dataclass(frozen=True, slots=True, eq=False)
class Updated:
    """A frame whose belief is updated, and which is not reported yet."""

    frame: DepthFrame
    state: TrackerState  # after it
    belief: Belief | None  # the same as in the state
    status: Status | None  # None: judge by the belief
    answered: int  # particles
    sighted: Sighted | None  # None where nothing of the body was seen
    clock: Stopwatch
