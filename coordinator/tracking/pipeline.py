"""Frames in their order through a tracker, so that neither the workers nor the coordinator wait."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from common.frame import DepthFrame
from coordinator.tracking.estimate import Estimate
from coordinator.tracking.look_ahead import Lookahead
from coordinator.tracking.single import SingleTracker as Tracker
from coordinator.tracking.state import TrackerState


def follow(tracker: Tracker, frames: Iterable[DepthFrame]) -> Iterator[tuple[Estimate, TrackerState]]:
    """Track frames: each frame's estimate, and all that was known after it.

    The results are those of `track`, frame by frame. Only the order of work differs: an estimate is given out
    while the workers are busy with the next frame. It is given out also where the next frame fails.
    """
    frames, tracked = Lookahead(frames), None
    try:
        for frame in frames:
            submitted = tracker.submit(frame)  # n + 1 is with the workers
            if tracked is not None:
                reported, tracked = tracker.report(tracked), None
                yield reported.estimate, reported.state  # n is recorded meanwhile
            tracker.send_ahead(frames.peek())  # n + 2 waits at the workers
            tracked = tracker.collect(submitted)  # n + 1
    except (Exception, KeyboardInterrupt):
        if tracked is not None:
            reported = tracker.report(tracked)
            yield reported.estimate, reported.state
        raise
    if tracked is not None:
        reported = tracker.report(tracked)
        yield reported.estimate, reported.state
