"""One frame on its way through the tracker: submitted to the workers, tracked."""

from __future__ import annotations

from dataclasses import dataclass

from common.frame import DepthFrame
from coordinator.filters.belief import Belief
from coordinator.tracking.certainty.evidence import Sighted
from coordinator.tracking.estimate import Status
from coordinator.tracking.inference import Request
from coordinator.tracking.search.seeker import Finding
from coordinator.tracking.state import TrackerState
from coordinator.tracking.stopwatch import Stopwatch


@dataclass(frozen=True, slots=True, eq=False)
class Submitted:
    """A frame whose particles are with the workers."""

    frame: DepthFrame
    request: Request | None  # None where there is no body yet, or nothing that it could be refined on
    shows: bool  # something, be it the body or not
    rival: Finding | None  # the body elsewhere, if it was looked for
    clock: Stopwatch


@dataclass(frozen=True, slots=True, eq=False)
class Tracked:
    """A frame that was tracked, and is not reported yet."""

    frame: DepthFrame
    state: TrackerState  # after it
    belief: Belief | None  # the same as in the state
    status: Status | None  # None: judge by the belief
    answered: int  # particles
    sighted: Sighted | None  # None where nothing of the body was seen
    clock: Stopwatch
