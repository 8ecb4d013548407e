"""Frames in their order through several people's followers, so that the workers seldom wait."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from common.frame import DepthFrame
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.look_ahead import Lookahead
from coordinator.tracking.people.crowd import Crowd
from coordinator.tracking.state import TrackerState
from coordinator.tracking.step import Tracked

Results = list[tuple[Estimate, TrackerState]]


def follow_all(crowd: Crowd, frames: Iterable[DepthFrame]) -> Iterator[Results]:
    """Track frames: each frame's estimates, one a person, and all that was known of each after it.

    The results are those of `track`, frame by frame. An estimate is given out while the workers are busy with
    the next frame, also where that fails.
    """
    frames, before = Lookahead(frames), list[Tracked]()
    try:
        for frame in frames:
            sight, tracked = crowd.see(frame), list[Tracked]()
            for place in range(crowd.people):
                submitted = crowd.submit(place, sight)  # this person's particles are with the workers
                if before:
                    found, before = results(crowd, before), []
                    yield found  # the frame before is recorded meanwhile
                crowd.send_ahead(place + 1, sight)
                if place + 1 == crowd.people:
                    frames.peek()
                tracked.append(crowd.collect(place, submitted))
            before = tracked
    except (Exception, KeyboardInterrupt):
        if before:
            yield results(crowd, before)
        raise
    if before:
        yield results(crowd, before)


def results(crowd: Crowd, tracked: list[Tracked]) -> Results:
    """What was found, and what was known after it."""
    return [(each.estimate, each.state) for each in crowd.report(tracked)]
